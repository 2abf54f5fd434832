"""One exposure in one line, in the operator's words."""

from rsoconsole.cli.output import direction_text
from rsoconsole.engine.loop import Engine
from rsoconsole.pipeline.reduce import Reduction


def cycle_line(engine: Engine, reduction: Reduction) -> str:
    """What the frame showed and what the loop makes of it."""
    following = engine.following
    words = [f"{engine.frame_id:4d} {following.state:8}"]
    track, taken = following.track, following.taken
    if following.state == "TRACK" and track is not None and taken is not None:
        words.append(f"{direction_text(taken.ra_icrs_deg, taken.dec_icrs_deg)}")
        words.append(f"confidence {taken.confidence:.2f}")
        if track.innovation_arcsec is not None and track.sigma_innovation_arcsec is not None:
            east, north = track.innovation_arcsec
            bounds = [3.0 * sigma for sigma in track.sigma_innovation_arcsec]
            words.append(f'residual {east:+.1f}" {north:+.1f}"')
            words.append(f'3 sigma {bounds[0]:.1f}" {bounds[1]:.1f}"')
    elif reduction.measurements:
        best = reduction.measurements[0]
        words.append(f"confidence {best.confidence:.2f}, {len(reduction.measurements)} measured")
    else:
        words.append(reduction.absence)
    words.append(f"{reduction.star_count} stars")
    return "  ".join(words)
