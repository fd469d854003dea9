"""Short steps are taken in the way that took less time, and the other is tried now and then."""

from warpknit.compute.team import TRIAL, Pace


def test_the_faster_way_is_taken_and_the_other_is_tried():
    pace, seconds = Pace(), {True: 3.0, False: 2.0}
    taken = []
    for call in range(3 * TRIAL):
        if call == 2 * TRIAL:
            seconds[True] = 1.0  # the other programs have ended
        taken.append(pace.is_shared())
        pace.took(taken[-1], seconds[taken[-1]])
    assert taken[:2] == [True, False]  # both are tried first
    assert sum(taken[2 : 2 * TRIAL]) == 2  # one trial in TRIAL calls
    assert sum(taken[2 * TRIAL :]) == 1  # by which it is noticed, for the calls after that
    assert pace.is_shared()
