"""The fold of a night and its view: what both have under one name is one thing."""

from dataclasses import fields

from rsoconsole.night.night_view import NightView, Now


def test_what_a_view_takes_over_has_the_same_type_there():
    of_view = {each.name: each.type for each in fields(NightView)}
    shown = Now(is_closed=False).shown()
    assert len(shown) >= 20
    for each in fields(Now):
        if each.name in of_view:
            assert each.type == of_view[each.name], each.name
            assert each.name in shown
