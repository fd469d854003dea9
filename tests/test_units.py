"""Quantities with units as they stand in a scene file."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from warpknit.scene.units import QuantityError, si


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("15 um", "length", 15e-6),
        ("15um", "length", 15e-6),
        ("17 µm", "length", 17e-6),
        ("0.015 mm", "length", 15e-6),
        (1.5e-5, "length", 15e-6),
        ("1.5e-5", "length", 15e-6),
        ("1.2 mil", "length", 3.048e-5),
        ("400 GPa", "stress", 400e9),
        ("-190 degC", "temperature", 83.15),
        ("20 °C", "temperature", 293.15),
        ("293.15 K", "temperature", 293.15),
        ("68 degF", "temperature", 293.15),
        ("2 N/m", "tension", 2.0),
        ("12 /cm", "per_length", 1200.0),
        ("12 1/cm", "per_length", 1200.0),
        ("19.25 g/cm3", "density", 19250.0),
        ("19250 kg/m^3", "density", 19250.0),
        ("4.5e-6 /K", "expansion", 4.5e-6),
        ("4.5e-6 /degC", "expansion", 4.5e-6),
        ("10 %", "number", 0.1),
        ("1 min", "time", 60.0),
        (0, "force", 0.0),
    ],
)
def test_quantity_is_read_in_si(text, dimension, expected):
    assert si(text, dimension) == expected


@pytest.mark.parametrize(
    "value",
    ["15 kg", "15 bananas", "nan um", "inf m", "1e999 m", "um", "", "15 um um", "15 2 um", "5 m**(2", "15 um\nx = 1"]
    + [math.nan, math.inf, -math.inf, True, None, [1], {}, 10**400],
)
def test_what_is_no_length_is_refused_with_an_example(value):
    with pytest.raises(QuantityError, match=r" '15 um'$"):
        si(value, "length")


@given(st.floats(min_value=1e-9, max_value=1e9))
def test_a_quantity_written_in_si_comes_back_to_the_same_bits(value):
    assert si(f"{value!r} m", "length") == value


def test_the_case_of_a_unit_is_named_as_the_fault():
    with pytest.raises(QuantityError, match=r"GPa, not Gpa"):
        si("320 Gpa", "stress")
    with pytest.raises(QuantityError) as refused:
        si("320 kg", "stress")
    assert refused.value.hint == ""
