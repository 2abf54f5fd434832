"""Uncatalogued objects of the ledger in lines of at most 80 columns for people."""

from collections.abc import Iterator
from pathlib import Path

from rsoconsole.cli.words import output
from rsoconsole.session import LedgerObject
from rsoconsole.words import direction, plus_minus, utc_text

_NAME_WIDTH = 16
HEADER = (
    f"{'':>4}  {'name':{_NAME_WIDTH}} {'tracks':>6}  {'last seen, UTC':16}  {'a, km':>16}"
    f"  {'i, deg':>6}  {'mag':>5}"
)


def object_list_line(known: LedgerObject) -> str:
    """Line of one uncatalogued object in the list."""
    orbit = known.last.orbit
    size = "no orbit" if orbit is None else plus_minus(orbit.a_km, orbit.sigma_a_km)
    tilt = "" if orbit is None else f"{orbit.i_deg:.2f}"
    light = "" if known.standard_mag is None else f"{known.standard_mag:.1f}"
    return (
        f"{known.number:>4}  {known.called[:_NAME_WIDTH]:{_NAME_WIDTH}} {len(known.tracks):>6} "
        f" {utc_text(known.last.t_last_utc_ns, 'dated minute', '')}  {size:>16}  {tilt:>6}"
        f"  {light:>5}"
    ).rstrip()


def object_detail_lines(known: LedgerObject) -> Iterator[str]:
    """Lines on all that is known of one uncatalogued object."""
    yield f"UCT {known.number}" + (f": {known.name}" if known.name else "")
    last = known.last
    yield f"  last direction   {direction(last.ra_icrs_deg, last.dec_icrs_deg, 'bare')}"
    yield (
        f"  motion           {last.rate_east_arcsec_s:+.3f} arcsec/s east,"
        f" {last.rate_north_arcsec_s:+.3f} north"
    )
    orbit = last.orbit
    if orbit is None:
        yield "  no orbit: its direction and motion are kept"
    else:
        nights = "one track" if orbit.nights == 1 else f"{orbit.nights} tracks"
        yield f"  orbit            {orbit.label}, of {nights}, rms {orbit.rms_arcsec:.2f} arcsec"
        yield f"  semi-major axis  {orbit.a_km:.1f} ± {orbit.sigma_a_km:.1f} km"
        yield f"  eccentricity     {orbit.e:.6f}"
        yield f"  inclination      {orbit.i_deg:.4f} deg"
    if known.standard_mag is not None and known.standard_mag_sigma is not None:
        light = f"{known.standard_mag:.2f} ± {known.standard_mag_sigma:.2f}"
        yield f"  magnitude        {light} in V at 1000 km and a phase angle of 90 deg"
    yield "  tracks:"
    for each in known.tracks:
        yield (
            f"    {utc_text(each.t_first_utc_ns, 'dated minute', '')}"
            f" to {utc_text(each.t_last_utc_ns, 'minute', '')}"
            f"  {each.observations:4d} directions  {each.session}, track {each.track_id}"
        )


def report_moved_ledger(aside: Path | None) -> None:
    """Report on stderr where a damaged ledger was moved to; do nothing for None."""
    if aside is not None:
        output.print_to_stderr(
            f"rsoconsole: the ledger was damaged: it is in {aside} as it was, and goes on with the"
            " lines that can be read"
        )
