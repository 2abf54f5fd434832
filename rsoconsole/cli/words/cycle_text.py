"""One exposure in one line of at most 80 columns, in the operator's words."""

from rsoconsole.engine import Engine
from rsoconsole.pipeline import Reduction
from rsoconsole.words import direction

HEADING = 'frame state    RA          Dec         confidence  residual ± 3 sigma (")'


def cycle_line(engine: Engine, reduction: Reduction) -> str:
    """What the frame showed and what the loop makes of it; ``HEADING`` names the columns."""
    following = engine.following
    start = f"{engine.frame_id:5d} {following.state:8}"
    track, taken = following.track, following.taken
    if following.state == "TRACK" and track is not None and taken is not None:
        place = direction(taken.ra_icrs_deg, taken.dec_icrs_deg, "bare")
        line = f"{start} {place} {taken.confidence:9.2f}"
        if track.innovation_arcsec is None or track.sigma_innovation_arcsec is None:
            return f"{line}   two frames agree: locked"
        east, north = track.innovation_arcsec
        bounds = [3.0 * sigma for sigma in track.sigma_innovation_arcsec]
        return f"{line}   {east:+5.1f} ± {bounds[0]:.1f}  {north:+5.1f} ± {bounds[1]:.1f}"
    if reduction.measurements:
        best = reduction.measurements[0]
        place = direction(best.ra_icrs_deg, best.dec_icrs_deg, "bare")
        return f"{start} {place} {best.confidence:9.2f}   measured, not followed yet"
    return f"{start} {reduction.absence}, {reduction.star_count} stars"
