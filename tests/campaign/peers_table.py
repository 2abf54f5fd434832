"""The table of the detector beside its peers: one column a peer, one row a family."""

from collections.abc import Callable, Mapping, Sequence
from statistics import median

from tests.bench.peers.roster import PEERS
from tests.campaign.families import FAMILIES
from tests.campaign.pairs import SIGNIFICANT, Key, Look, Pairs, false_above, paired

OURS = "rsoconsole"
TAU = 0.10
_ITSELF = tuple(name for name, peer in PEERS.items() if peer.module == PEERS[OURS].module)
RATES = (0.1, 1.0)
"""False candidates a frame, of further operating points."""
All = Mapping[str, Mapping[Key, Look]]


def table(looks: All) -> str:
    """Recall at the product's own false positives, then at others, then costs; and the verdict."""
    ours = looks.get(OURS, {})
    peers = [name for name in looks if name != OURS]
    if not ours or not peers:
        return "Nothing to compare yet.\n"
    at_tau = {name: paired(ours, looks[name], tau=TAU) for name in peers}
    families = [name for name in FAMILIES if any(name == family for family, _ in ours)]
    rows = [["", OURS, *peers], ["---"] * (len(peers) + 2)]
    for family in families:
        rows.append([FAMILIES[family].title, _own(ours, family)])
        rows[-1] += [_cell(at_tau[name].get(family)) for name in peers]
    rows.append(["**all together**", _own(ours, "")] + [_cell(at_tau[name][""]) for name in peers])
    for rate in RATES:
        pairs = [paired(ours, looks[name], tau=None, rate=rate)[""] for name in peers]
        itself = paired(ours, ours, tau=None, rate=rate)[""]
        rows.append([f"at {rate:g} false a frame", f"{itself.ours:.2f}", *map(_cell, pairs)])
    for title, figure in _COSTS.items():
        rows.append([title, *(figure(list(looks[name].values())) for name in (OURS, *peers))])
    false = false_above(ours, TAU)
    body = "".join("| " + " | ".join(row) + " |\n" for row in rows)
    return (
        f"{body}\n{_verdict(at_tau)} False candidates above tau: {false} in {len(ours)} frames.\n"
    )


def _own(ours: Mapping[Key, Look], family: str) -> str:
    scores = [look.score or 0.0 for key, look in ours.items() if family in ("", key[0])]
    hits = sum(score > TAU for score in scores)
    return f"{hits / len(scores):.2f} ({hits} of {len(scores)})"


def _cell(pairs: Pairs | None) -> str:
    """The peer's recall, and how many satellites only the product and only the peer found."""
    if pairs is None or not pairs.frames:
        return "-"
    mark = " **lower**" if pairs.is_ours_lower else ""
    return f"{pairs.theirs:.2f} (+{pairs.ours_alone} -{pairs.theirs_alone}){mark}"


def _verdict(at_tau: Mapping[str, Mapping[str, Pairs]]) -> str:
    # The product in another mode is no rival.
    rivals = {n: each for n, each in at_tau.items() if n not in _ITSELF}
    lower = [
        f"{name} in {family} ({each.ours_alone} against {each.theirs_alone}, p {each.p_value:.3f})"
        for name, by_family in rivals.items()
        for family, each in by_family.items()
        if family and each.is_ours_lower
    ]
    ahead = [n for n, by_family in rivals.items() if by_family[""].theirs >= by_family[""].ours]
    text = f"Significantly lower (p < {SIGNIFICANT:g}) than: " + ("; ".join(lower) or "none") + "."
    return f"{text} Not higher over all families than: " + ("; ".join(ahead) or "none") + "."


def _median(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{median(known):.2f}" if known else "-"


_COSTS: Mapping[str, Callable[[Sequence[Look]], str]] = {
    "midpoint of those found, px, median": lambda looks: _median([x.off_px for x in looks]),
    "false candidates a frame, in all": lambda looks: (
        f"{sum(x.false_count for x in looks) / len(looks):.2f}"
    ),
    "processor's seconds a frame, median": lambda looks: _median([x.cpu_s for x in looks]),
    "frames (without an answer)": lambda looks: (
        f"{len(looks)} ({sum(bool(x.error) for x in looks)})"
    ),
}
