"""How far a mount moves on once it has been told to stop, learned from its own stops. Pure."""

UNLEARNED_DEG = 5.0
UNLEARNED_S = 5.0
"""A mount of which nothing is known takes no longer to stop than this, nor farther than that."""
MIN_DEG, MAX_DEG = 0.5, 15.0
SLOW_DEG_S = 0.02
"""At a lower rate than this nothing is learned."""
FASTER = 2.0
"""What was learned at a rate is believed at rates up to twice as high."""


class StoppingDistance:
    """The farthest that this mount has been seen to move on, by the rate at which it was told."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, float]] = []

    def learn(self, way_deg: float, rate_deg_s: float) -> None:
        """It was told to stop at this rate, and rested so far on."""
        if rate_deg_s > SLOW_DEG_S:
            self._seen.append((rate_deg_s, min(max(way_deg, MIN_DEG), MAX_DEG)))

    @property
    def is_learned(self) -> bool:
        """Whether it has been seen to stop."""
        return bool(self._seen)

    def at(self, rate_deg_s: float) -> float:
        """How far it may move on at this rate, degrees of the faster axis.

        At lower rates than those that were seen the way is taken to be shorter in proportion, at
        higher ones as their square.
        """
        known = [
            way_deg * (share if (share := rate_deg_s / seen_deg_s) <= 1.0 else share * share)
            for seen_deg_s, way_deg in self._seen
            if rate_deg_s <= FASTER * seen_deg_s
        ]
        if not known:
            return min(UNLEARNED_DEG, UNLEARNED_S * rate_deg_s)
        return min(max(MIN_DEG, *known), MAX_DEG)
