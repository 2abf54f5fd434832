"""The fast tier leaves out what took longest, and nothing that is not there."""

from pathlib import Path

from tests.fast_tier import chosen, is_slow, slow_tests

RUN = """
9.00s call     tests/engine/test_a.py::test_long[one]
8.00s call     tests/engine/test_a.py::test_long[two]
0.50s setup    tests/engine/test_a.py::test_short
3.00s call     tests/sky/test_b.py::test_all[x-y]
0.40s teardown tests/sky/test_c.py::test_quick
"""


def test_the_slowest_are_left_out_until_the_rest_fits() -> None:
    assert chosen(RUN, 30.0) == []
    assert chosen(RUN, 4.0) == ["engine/test_a.py::test_long"]
    assert chosen(RUN, 1.0) == ["engine/test_a.py::test_long", "sky/test_b.py"]


def test_a_file_whose_tests_share_a_slow_fixture_is_left_out_whole() -> None:
    shared = """
    9.00s setup    tests/engine/test_d.py::test_first
    0.10s call     tests/engine/test_d.py::test_first
    0.20s call     tests/engine/test_d.py::test_second
    0.50s setup    tests/sky/test_e.py::test_one
    0.20s call     tests/sky/test_e.py::test_two
    """
    assert chosen(shared, 1.0) == ["engine/test_d.py"]


def test_a_case_a_function_and_a_file_are_known_by_the_list() -> None:
    slow = frozenset(("engine/test_a.py::test_long", "sky/test_b.py"))
    assert is_slow("tests/engine/test_a.py::test_long[one]", slow)
    assert is_slow("tests/sky/test_b.py::test_all[x-y]", slow)
    assert not is_slow("tests/engine/test_a.py::test_short", slow)


def test_what_the_list_names_is_there() -> None:
    for name in slow_tests():
        path, _, function = name.partition("::")
        text = (Path(__file__).parents[1] / path).read_text(encoding="utf-8")
        assert not function or f"def {function.rpartition('::')[2]}(" in text, name
