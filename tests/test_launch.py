"""Arguments of kernels are bound by name: what is wrong with a name is said before anything is launched."""

from types import SimpleNamespace

import pytest
import warp as wp

from warpknit.compute.device import start_warp
from warpknit.compute.launch import bind

start_warp()


@wp.kernel
def add_scaled(
    # in
    factor: wp.float64,
    term: wp.array(dtype=wp.float64),
    # in and out
    total: wp.array(dtype=wp.float64),
):
    i = wp.tid()
    total[i] = total[i] + factor * term[i]


def numbers(*values: float) -> wp.array:
    return wp.array(values, dtype=wp.float64, device="cpu")


def test_named_arguments_come_before_attributes_of_sources():
    model, state = SimpleNamespace(term=numbers(1.0, 2.0), factor=wp.float64(5.0)), SimpleNamespace(total=numbers(1.0, 1.0))
    bind(add_scaled, 2, model, state, factor=wp.float64(3.0)).run("cpu")
    assert state.total.numpy().tolist() == [4.0, 7.0]


def test_recorded_launch_can_be_repeated():
    total = numbers(0.0)
    command = bind(add_scaled, 1, factor=wp.float64(2.0), term=numbers(1.0), total=total).record("cpu")
    assert total.numpy().tolist() == [0.0]
    command.launch()
    command.launch()
    assert total.numpy().tolist() == [4.0]


def test_missing_argument():
    with pytest.raises(TypeError, match="total of kernel add_scaled .* SimpleNamespace"):
        bind(add_scaled, 1, SimpleNamespace(term=numbers(1.0)), factor=wp.float64(1.0))


def test_ambiguous_argument():
    one, other = SimpleNamespace(term=numbers(1.0), total=numbers(1.0)), SimpleNamespace(term=numbers(1.0))
    with pytest.raises(TypeError, match="term of kernel add_scaled"):
        bind(add_scaled, 1, one, other, factor=wp.float64(1.0))


def test_superfluous_argument():
    everything = SimpleNamespace(term=numbers(1.0), total=numbers(1.0), factor=wp.float64(1.0))
    with pytest.raises(TypeError, match="kernel add_scaled .*facter.* factor, term, total"):
        bind(add_scaled, 1, everything, facter=wp.float64(1.0))
