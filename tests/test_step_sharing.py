"""Short steps are taken in the way that took less time, and the other is tried now and then."""

from warpknit.compute.team import RETRY_CALLS, StepSharing


def test_the_faster_way_is_taken_and_the_other_is_tried():
    sharing, seconds = StepSharing(), {True: 3.0, False: 2.0}
    taken = []
    for call in range(3 * RETRY_CALLS):
        if call == 2 * RETRY_CALLS:
            seconds[True] = 1.0  # the other programs have ended
        taken.append(sharing.is_shared())
        sharing.note_time(taken[-1], seconds[taken[-1]])
    assert taken[:2] == [True, False]  # both are tried first
    assert sum(taken[2 : 2 * RETRY_CALLS]) == 2  # one trial in RETRY_CALLS calls
    assert sum(taken[2 * RETRY_CALLS :]) == 1  # by which it is noticed, for the calls after that
    assert sharing.is_shared()
