"""Runs a program with the system calls of a unit's SystemCallFilter= alone, by Debian's own Python.

    /usr/bin/python3 tests/children/jail.py "@system-service" "~@privileged @clock" -- PROGRAM ...

What is not among them fails with EPERM. Needs python3-seccomp and systemd-analyze.
"""

import errno
import os
import subprocess
import sys

import seccomp


def members(group: str) -> set[str]:
    """The calls of a group, those of the groups in it too."""
    asked = ["systemd-analyze", "syscall-filter", "--no-pager", group]
    said = subprocess.run(asked, capture_output=True, text=True, check=True).stdout
    words = {line.partition("#")[0].strip() for line in said.splitlines()[1:]} - {""}
    inner = {word for word in words if word.startswith("@")}
    return (words - inner).union(*map(members, inner))


def allowed(filters: list[str]) -> set[str]:
    """What is left after all lines, in order."""
    found = members("@default")
    for line in filters:
        is_denied, groups = line.startswith("~"), line.removeprefix("~").split()
        for group in groups:
            calls = members(group) if group.startswith("@") else {group}
            found = found - calls if is_denied else found | calls
    return found


def main() -> None:
    """Load the filter and become the program."""
    split = sys.argv.index("--")
    jail = seccomp.SyscallFilter(seccomp.ERRNO(errno.EPERM))
    for name in sorted(allowed(sys.argv[1:split])):
        try:
            jail.add_rule(seccomp.ALLOW, name)
        except (RuntimeError, ValueError, OSError):
            continue  # a call of another machine
    jail.load()
    os.execvp(sys.argv[split + 1], sys.argv[split + 1 :])


if __name__ == "__main__":
    main()
