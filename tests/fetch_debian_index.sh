#!/bin/sh
# Fetch Debian's Tycho-2 index files without root into .cache/index (or the folder named as $1).
# The tests that need whole-sky index files look there; an observer may install from there:
#     rsoconsole index install --from .cache/index
set -eu
target=${1:-"$(dirname "$0")/../.cache/index"}
mkdir -p "$target"
cd "$target"
# The packages without -littleendian hold nothing but a dependency on these.
for scales in 07 08 09 10-19; do
    package=astrometry-data-tycho2-$scales-littleendian
    if [ -e "$package.done" ]; then
        continue
    fi
    apt-get download "$package"
    for archive in "${package}"_*.deb; do
        dpkg -x "$archive" .
        rm "$archive"
    done
    touch "$package.done"
done
find . -name 'index-*.fits'
