"""The comparison with peers counts pairs at equal false positives, and goes on where it stopped."""

import sys

import numpy as np
import pytest

from rsoconsole.simulator import straight_streak
from tests.bench.peers.astride_contours import _linked
from tests.bench.peers.roster import PEERS, Peer, present
from tests.bench.peers.scoring import Candidate, Line, threshold_at
from tests.campaign import looks, peers
from tests.campaign.families import Truth
from tests.campaign.pairs import Look, Pairs, paired
from tests.campaign.peers_table import table

TRUTH = Truth(x_a_px=100.0, y_a_px=100.0, x_b_px=200.0, y_b_px=100.0, snr=50.0, severity=1.0)


def look(score, *false, error=""):
    return Look(
        score=score, off_px=None, false=false, false_count=len(false), cpu_s=1.0, error=error
    )


def frames(family, *seen):
    return {(family, number): each for number, each in enumerate(seen)}


def test_the_threshold_lets_through_as_many_false_ones_as_granted():
    assert threshold_at([3.0, 9.0, 5.0], 0) == 9.0
    assert threshold_at([3.0, 9.0, 5.0], 1) == 5.0
    assert threshold_at([3.0, 9.0, 5.0], 3) == -np.inf


def test_a_peer_is_judged_at_the_false_positives_of_the_product():
    ours = frames("blur", look(0.9), look(0.05), look(0.8, 0.5))  # one false one above tau
    theirs = frames("blur", look(20.0, 30.0), look(25.0), look(15.0, 18.0))
    pairs = paired(ours, theirs, tau=0.10)["blur"]  # theirs: the lowest above 18
    assert (pairs.both, pairs.ours_alone, pairs.theirs_alone) == (1, 1, 1)
    silent = frames("blur", look(0.9), look(0.05), look(0.8))  # none: theirs above 30
    pairs = paired(silent, theirs, tau=0.10)["blur"]
    assert (pairs.both, pairs.ours_alone, pairs.theirs_alone) == (0, 2, 0)


def test_only_frames_that_both_looked_at_count_and_their_false_ones_alone():
    ours = frames("blur", look(0.9), look(0.9, 0.8, 0.7))
    theirs = frames("blur", look(2.0, 5.0))
    pairs = paired(ours, theirs, tau=0.10)[""]
    assert (pairs.frames, pairs.ours, pairs.theirs) == (1, 1.0, 0.0)


def test_families_share_one_threshold():
    ours = frames("blur", look(0.9)) | frames("ring", look(0.9))
    theirs = frames("blur", look(2.0)) | frames("ring", look(4.0, 3.0))
    pairs = paired(ours, theirs, tau=0.10)
    assert (pairs["blur"].theirs, pairs["ring"].theirs, pairs[""].theirs) == (0.0, 1.0, 0.5)


@pytest.mark.parametrize(
    ("ours", "theirs", "p_value", "is_lower"),
    [(0, 6, 2 / 64, True), (0, 5, 2 / 32, False), (6, 0, 2 / 64, False), (0, 0, 1.0, False)],
)
def test_significance_is_the_binomials_of_the_pairs_that_differ(ours, theirs, p_value, is_lower):
    pairs = Pairs(frames=40, both=3, ours_alone=ours, theirs_alone=theirs)
    assert pairs.p_value == pytest.approx(p_value)
    assert pairs.is_ours_lower is is_lower


def test_a_trail_beside_the_satellite_counts_neither_way():
    said = {"candidates": [[0, 300, 900, 300, 7.0], [0, 600, 60, 600, 6.0]], "cpu_s": 1.0}
    crossing = straight_streak((-500.0, 300.0), (1500.0, 300.0), 1.0)
    assert peers.look_of(said, TRUTH, []).false == (7.0, 6.0)
    assert peers.look_of(said, TRUTH, [crossing]).false == (6.0,)


def test_a_frame_without_an_answer_is_one_where_nothing_was_found():
    lost = peers.look_of({"error": "no answer in 300 s"}, TRUTH, [])
    assert (lost.score, lost.false, lost.error) == (None, (), "no answer in 300 s")


def test_a_stopped_run_goes_on_and_looks_again_at_what_is_void(tmp_path):
    path = tmp_path / "looks.jsonl"
    made = looks.digest("rsoconsole")
    looks.append(path, "rsoconsole", made, ("blur", 0), look(0.9, 0.2))
    looks.append(path, "rsoconsole", "of other code", ("blur", 1), look(0.9))
    with path.open("a") as rows:
        rows.write('{"peer": "rsoconsole", "fam')
    looks.end_line(path)
    looks.append(path, "OpenCV LSD", looks.digest("OpenCV LSD"), ("blur", 1), look(None))
    assert looks.read(path)["rsoconsole"] == {("blur", 0): look(0.9, 0.2)}
    names = ["rsoconsole", "OpenCV LSD", "acstools findsat_mrt"]
    left = list(peers.missing(path, ["blur"], names, count=2, slow_count=1))
    assert left == [
        (("blur", 0), ["OpenCV LSD", "acstools findsat_mrt"]),
        (("blur", 1), ["rsoconsole"]),
    ]


def test_the_table_says_where_the_product_is_behind():
    found, lost = [look(0.9)] * 8, [look(None)] * 8
    ours = frames("blur", *lost) | frames("ring", *found)
    text = table(
        {
            "rsoconsole": ours,
            "better": frames("blur", *found),
            "worse": frames("blur", *lost) | frames("ring", *lost),
        }
    )
    assert "1.00 (+0 -8) **lower**" in text
    assert "0.00 (+8 -0) |" in text
    assert "Significantly lower (p < 0.05) than: better in blur (0 against 8, p 0.008)." in text
    assert "Not higher over all families than: better." in text


def test_a_peer_that_is_not_installed_is_told_with_its_remedy(monkeypatch, capsys):
    absent = Peer(module="astride_contours", package="nowhere_at_all", remedy="pip install it")
    monkeypatch.setitem(PEERS, "ASTRiDE", absent)
    assert present(["rsoconsole", "ASTRiDE"]) == ["rsoconsole"]
    assert "ASTRiDE takes no part: no package nowhere_at_all here: pip install it" in (
        capsys.readouterr().out
    )


def test_a_peer_with_a_python_of_its_own_is_told_where_to_name_it(monkeypatch, capsys):
    monkeypatch.delenv("SENPAI_PYTHON", raising=False)
    assert present(["rsoconsole", "SENPAI"]) == ["rsoconsole"]
    assert "SENPAI takes no part: no Python in SENPAI_PYTHON: pip" in capsys.readouterr().out
    monkeypatch.setenv("SENPAI_PYTHON", sys.executable)
    assert present(["SENPAI"]) == ["SENPAI"]


@pytest.mark.parametrize(
    ("changed", "void"),
    [
        ("models/line_verifier.tflite", {"rsoconsole"}),
        ("rsoconsole/vision/lines/segments.py", {"rsoconsole"}),
        ("rsoconsole/vision/frame/bins.py", {"rsoconsole", "OpenCV LSD"}),
        ("models/altered.py", {"rsoconsole", "OpenCV LSD", "ASTRiDE"}),
    ],
)
def test_another_detector_of_ours_leaves_the_peers_rows(monkeypatch, tmp_path, changed, void):
    monkeypatch.setattr(looks, "_ROOT", tmp_path)
    names = ["rsoconsole", "OpenCV LSD", "ASTRiDE"]
    before = [looks.digest(name) for name in names]
    (tmp_path / changed).parent.mkdir(parents=True)
    (tmp_path / changed).write_text("of another commit")
    assert {n for n, made in zip(names, before, strict=True) if looks.digest(n) != made} == void


def test_linked_contours_are_one_streak():
    lines = [(0.0, 40.0), (60.0, 100.0), (300.0, 310.0)]
    found = [
        Candidate(line=Line(x_a_px=a, y_a_px=5.0, x_b_px=b, y_b_px=5.0), score=b) for a, b in lines
    ]
    edges = [{"index": 1, "connectivity": 2}, {"index": 2, "connectivity": -1}]
    edges.append({"index": 3, "connectivity": -1})
    whole = _linked(edges, found)
    assert sorted((c.line.length_px, c.score) for c in whole) == [(10.0, 310.0), (100.0, 100.0)]
