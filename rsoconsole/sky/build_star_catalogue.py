"""Cut the shipped star catalogue out of an index file.

``python -m rsoconsole.sky.build_star_catalogue INDEX [OUT] [DEC_LIMIT]``
"""

import sys
from pathlib import Path

from rsoconsole.sky.star_catalogue import StarCatalogue

USAGE = "usage: python -m rsoconsole.sky.build_star_catalogue INDEX [OUT.npz] [DEC_LIMIT_DEG]"


def build(index: Path, out: Path, dec_limit_deg: float = 12.0) -> StarCatalogue:
    """Write the stars within +-dec_limit_deg of the equator; gives back what was written."""
    catalogue = StarCatalogue.from_index(index, -dec_limit_deg, dec_limit_deg)
    catalogue.save(out)
    return catalogue


def main(arguments: list[str]) -> int:
    """Exit status: 0 written, 2 wrong usage."""
    if not 1 <= len(arguments) <= 3:
        sys.stderr.write(USAGE + "\n")
        return 2
    out = Path(arguments[1] if len(arguments) > 1 else "tycho2_belt.npz")
    limit = float(arguments[2]) if len(arguments) > 2 else 12.0
    catalogue = build(Path(arguments[0]), out, limit)
    sys.stdout.write(f"{out}: {len(catalogue)} stars, {out.stat().st_size} bytes\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
