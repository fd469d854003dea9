"""Results of a reflection: rows of reflection.csv, and the lines of the table of a command."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.text import engineering, sides_text
from ..results.finding import Finding
from ..results.row import Row, Values
from .repeat import CLOSED, OPEN
from .waves import Angles, Scattering

ROOM = 290.0  # [K] temperature of the wires, for their noise
SIDES = ("te", "tm")
NEAR_BEST = 0.02  # [dB] by which losses from the least tension on may differ
SAME = 1e-3  # of a tension: two searches for the same tension differ by less
SHOWN = 3  # frequencies in the table of a run


class LossRow(Row):
    """One state at one frequency: a row of reflection.csv. TE and TM are the polarisations of the incident wave."""

    record: int  # number of the record; of a map, of the pair of loads
    strain_weft: float  # strain of the state in weft
    strain_warp: float  # strain of the state in warp
    tension_weft_N_per_m: float  # force per current width in weft
    tension_warp_N_per_m: float  # force per current width in warp
    stress_max_Pa: float  # largest wire stress
    frequency_Hz: float  # frequency of the wave
    theta: float  # [rad] angle of incidence, from the normal
    phi: float  # [rad] direction of the wave along the mesh, from weft towards warp
    contacts: str  # state of the contacts: computed, open (none conducts) or closed (all are perfect)
    loss_te_dB: float  # reflection loss of a TE wave: power that is not in the reflected wave
    loss_tm_dB: float  # reflection loss of a TM wave
    transmitted_te: float  # share of the power behind the mesh
    transmitted_tm: float  # share of the power behind the mesh
    absorbed_te: float  # share of the power that becomes heat
    absorbed_tm: float  # share of the power that becomes heat
    crossed_te: float  # share of the power reflected as TM
    crossed_tm: float  # share of the power reflected as TE
    lobes_te: float  # share of the power in grating lobes; 0 below the first of them
    lobes_tm: float  # share of the power in grating lobes; 0 below the first of them
    ohmic_share_te: float  # share of the lost power that becomes heat
    ohmic_share_tm: float  # share of the lost power that becomes heat
    noise_te_K: float  # noise temperature of the heat, with the mesh at 290 K
    noise_tm_K: float  # noise temperature of the heat, with the mesh at 290 K

    @property
    def loss(self) -> float:
        """[dB] of the worse polarisation."""
        return max(self.loss_te_dB, self.loss_tm_dB)


class LeastTension(Values):
    """Least tension that reflects as well as all greater ones; null without one. Up to the elastic limit."""

    frequency_Hz: float  # frequency of the wave
    tension_weft_N_per_m: float | None  # least mean tension of weft and warp above which the losses of all records lie within
    # 0.02 dB, for the worse polarisation, up to the elastic limit; null without one
    tension_warp_N_per_m: float | None  # the same in warp
    loss_dB: float | None  # reflection loss at this tension, of the worse polarisation


COLUMNS = tuple(LossRow.__annotations__)
OF_STATE = COLUMNS[1 : COLUMNS.index("frequency_Hz")]  # columns of the recorded state


def loss_row(record: int, state: Values, frequency: float, angles: Angles, contacts: str, found: Scattering) -> LossRow:
    """Row of a recorded state at a frequency [Hz], with contacts in a state."""
    lost = np.maximum(1.0 - found.reflected, 0.0)
    powers = {
        "loss_{}_dB": found.loss,
        "transmitted_{}": found.transmitted,
        "absorbed_{}": found.absorbed,
        "crossed_{}": found.crossed,
        "lobes_{}": found.lobes,
        "ohmic_share_{}": np.divide(found.absorbed, lost, out=np.zeros(2), where=lost > 0.0),
        "noise_{}_K": ROOM * found.absorbed,
    }
    return LossRow(
        record=record,
        **{name: state[name] for name in OF_STATE},
        frequency_Hz=frequency,
        theta=angles.theta,
        phi=angles.phi,
        contacts=contacts,
        **{name.format(side): float(value) for name, both in powers.items() for side, value in zip(SIDES, both, strict=True)},
    )


@dataclass(frozen=True)
class Reflected:
    """The rows of the states of a run or a map."""

    rows: tuple[LossRow, ...]
    limit: float  # [Pa] elastic limit of the wire
    is_map: bool

    @property
    def frequencies(self) -> list[float]:
        """[Hz]"""
        return sorted({row.frequency_Hz for row in self.rows})

    @property
    def shown_frequencies(self) -> list[float]:
        """All frequencies [Hz], or first, middle and last of more than SHOWN."""
        every = self.frequencies
        return every if len(every) <= SHOWN else [every[0], every[len(every) // 2], every[-1]]

    def given(self, frequency: float) -> list[LossRow]:
        """Rows at a frequency [Hz] with contacts as computed, or as the scene sets."""
        return [row for row in self.rows if row.frequency_Hz == frequency and row.contacts == self.rows[0].contacts]

    def least(self, frequency: float) -> LossRow | None:
        """Row of the least tension at a frequency [Hz]."""
        return least_tension(self.given(frequency), self.limit)

    def record(self, frequency: float) -> int:
        """The last record; of a map, at the least tension at a frequency [Hz]."""
        return int(((self.least(frequency) if self.is_map else None) or self.rows[-1]).record)

    def of_state(self, record: int, frequency: float) -> dict[str, LossRow]:
        """Rows of a record at a frequency [Hz] by the state of the contacts; first as computed, or as the scene sets."""
        return {row.contacts: row for row in self.rows if (row.record, row.frequency_Hz) == (record, frequency)}

    def added_to(self, summary: Mapping[str, Any]) -> dict[str, Any]:
        """A summary with the section `reflection`, and least tensions among the answers.

        The section is of the last record; of a map, at the least tension and highest frequency.
        """
        losses, answers = [], []
        for frequency in self.frequencies:
            of_state = self.of_state(self.record(self.rows[-1].frequency_Hz), frequency)
            given = next(iter(of_state.values()))
            entry = {name: given[name] for name in COLUMNS[COLUMNS.index("frequency_Hz") :] if name != "contacts"}
            for state in (OPEN, CLOSED):
                for side in SIDES:
                    entry[f"loss_{state}_{side}_dB"] = of_state[state][f"loss_{side}_dB"] if state in of_state else None
            losses.append(entry)
            least = self.least(frequency)
            weft, warp, loss = (None, None, None) if least is None else (*least.tension, least.loss)
            answers.append(
                LeastTension(frequency_Hz=frequency, tension_weft_N_per_m=weft, tension_warp_N_per_m=warp, loss_dB=loss)
            )
        return dict(summary) | {"reflection": losses, "answers": (summary.get("answers") or {}) | {"reflection": answers}}

    @property
    def findings(self) -> list[Finding]:
        """Lines of the table: the loss of a record and the least tension, for a few of the frequencies."""
        return [finding for frequency in self.shown_frequencies for finding in self._findings_at(frequency)]

    def _findings_at(self, frequency: float) -> Iterator[Finding]:
        of_state, least = self.of_state(self.record(frequency), frequency), self.least(frequency)
        from_ = (
            f"least tension {sides_text(least.tension, 'N/m')}"
            if least
            else f"no least tension: the loss still changes by more than {NEAR_BEST:g} dB at larger tensions"
        )
        losses = _losses(next(iter(of_state.values())))
        yield Finding(f"reflection {engineering(frequency, 'Hz')}", f"loss {losses}; {from_}", short=True)
        for state in (OPEN, CLOSED):
            if state in of_state and len(of_state) > 1:
                yield Finding(f"  contacts {state}", _losses(of_state[state]))
        if least:
            yield Finding("  least tension", f"{least.loss:.3g} dB; within {NEAR_BEST:g} dB at larger tensions")


def least_tension(rows: Sequence[LossRow], limit: float) -> LossRow | None:
    """Row of the least tension with loss within NEAR_BEST from there on; rows at one frequency.

    Only rows with tension and a stress up to the limit [Pa] count. Rows with tensions at least as large in weft and warp have
    losses within NEAR_BEST of each other. At least two rows are needed. None if there is no such tension.
    """
    tight = [row for row in rows if min(row.tension) > 0.0 and row.stress_max_Pa <= limit]
    tension, loss = np.array([row.tension for row in tight]).reshape(-1, 2), np.array([row.loss for row in tight])
    for k in np.argsort(tension.sum(axis=1)):
        onwards = loss[(tension >= (1.0 - SAME) * tension[k]).all(axis=1)]
        if len(onwards) > 1 and np.ptp(onwards) <= NEAR_BEST:
            return tight[k]
    return None


def _losses(row: LossRow) -> str:
    names = ("warp", "weft") if row.theta == row.phi == 0.0 else ("TE", "TM")
    return f"{row.loss_te_dB:.3f} dB {names[0]}, {row.loss_tm_dB:.3f} dB {names[1]}"
