"""Two tracks beside each other, and who is missing from the field."""

from rsoconsole.records import PairMotion, UnseenMember
from rsoconsole.words.times import clock


def apart_words(pair: PairMotion) -> str:
    """253.2 ± 0.5″."""
    return f"{pair.separation_arcsec:.1f} ± {pair.sigma_separation_arcsec:.1f}″"


def nearing_words(pair: PairMotion) -> str:
    """-1.44 ± 0.03″/min: below 0 while they approach."""
    sigma = pair.sigma_separation_rate_arcsec_min
    return f"{pair.separation_rate_arcsec_min:+.2f} ± {sigma:.2f}″/min"


def closest_words(pair: PairMotion) -> str:
    """How near they come and when, or that they part."""
    hours = pair.horizon_s / 3600.0
    if pair.closest == "now":
        return f"they part, looked {hours:.1f} h ahead"
    within = f"{pair.closest_low_arcsec:.0f} to {pair.closest_high_arcsec:.0f}″"
    if pair.closest == "beyond":
        return f"still nearing in {hours:.1f} h: {within}"
    off_min = max(pair.sigma_closest_s / 60.0, 0.5)
    return f"least {within} at {clock(pair.closest_utc_ns, 'minute', '')} ± {off_min:.0f} min"


def unseen_words(name: str, member: UnseenMember) -> str:
    """Who is missing, where in the frame, and why it may not be seen."""
    whys = (("in shadow", member.is_lit), ("at the edge", member.is_usable))
    why = ", ".join(words for words, is_plain in whys if not is_plain)
    return f"{name} x {member.x_px:.0f} y {member.y_px:.0f} {why}".rstrip()
