"""Values in messages: prefixes, digits, and limits that are themselves allowed."""

from __future__ import annotations

import math

import pytest

from warpknit.base.text import alike, at_least, at_most, between, both, celsius, duration, engineering, exact, place_text


@pytest.mark.parametrize(
    ("value", "unit", "rounded", "typed"),
    [
        (0.0123456, "m", "12.3 mm", "12.3456 mm"),
        (15e-6, "m", "15 um", "15 um"),
        (0.0, "m", "0 m", "0 m"),
        (999.9e6, "Pa", "1 GPa", "999.9 MPa"),
        (4e12, "Pa", "4 TPa", "4 TPa"),
        (-1e-12, "N", "-1 pN", "-1 pN"),
        (1e6, "m", "1000 km", "1000 km"),
        (12345.0, "s", "12300 s", "12345 s"),
        (math.nan, "N/m", "nan N/m", "nan N/m"),
    ],
)
def test_values_have_a_prefix_and_what_was_typed_all_its_digits(value, unit, rounded, typed):
    assert engineering(value, unit) == rounded
    assert exact(value, unit) == typed


@pytest.mark.parametrize(
    ("values", "shown"),
    [
        ((5.4, 5.39), ["5.40 N/m", "5.39 N/m"]),
        ((3.0, 3.0), ["3 N/m", "3 N/m"]),
        ((0.5, 0.0503), ["500 mN/m", "50.3 mN/m"]),
        ((9.96, -10.0), ["9.96 N/m", "-10.0 N/m"]),
        ((100.0, 300.0), ["100 N/m", "300 N/m"]),
        ((0.0, 1.25), ["0 N/m", "1.25 N/m"]),
        ((1e-15, math.nan), ["1e-15 N/m", "nan N/m"]),
    ],
)
def test_values_of_a_row_have_the_same_number_of_digits(values, shown):
    assert alike(values, "N/m") == shown


def test_units_without_prefix():
    assert exact(19250.0, "kg/m^3") == "19250 kg/m^3" and exact(0.01, "") == "0.01"


def test_a_limit_is_rounded_to_the_allowed_side():
    assert (at_most(99.459, "N/m"), at_least(99.451, "N/m")) == ("99.45 N/m", "99.46 N/m")
    assert at_most(3 * 5e-6, "m") == at_least(3 * 5e-6, "m") == "15 um"  # not 14.99 um: 3 * 5e-6 is 1.5000000000000002e-05
    assert at_most(1 / 3, "course spacings") == "0.3333 course spacings"


def test_temperatures_and_times():
    assert [celsius(kelvin) for kelvin in (0.0, 83.15, 3695.0)] == ["-273.15 degC", "-190 degC", "3421.85 degC"]
    assert [duration(s) for s in (7.0714, 115.0, 9000.0, 3e7)] == ["7.1 s", "120 s", "2.5 h", "350 days"]
    assert duration(7.0714, 3) == "7.07 s"


@pytest.mark.parametrize(
    ("place", "shown"),
    [
        ((3.91e-9, 751e-6), "(0, 751) um"),
        ((145e-6, 604e-6), "(145, 604) um"),
        ((-1.4e-3, 45e-6), "(-1.4, 0.05) mm"),
        ((9.996e-4, 2e-4), "(1, 0.2) mm"),
        ((-3e-9, 2e-12), "(0, 0) nm"),
    ],
)
def test_the_coordinates_of_a_place_share_a_unit(place: tuple[float, float], shown: str) -> None:
    """To three digits of the larger one; what is within 10 nm of zero is zero."""
    assert place_text(*place) == shown


def test_ends_that_print_alike_are_one_value() -> None:
    assert both("50.0 %", "50.0 %") == "50.0 %" and between("50.0 %", "50.0 %") == "at 50.0 %"
    assert both("8 %", "34 %") in between("8 %", "34 %")
