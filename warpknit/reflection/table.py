"""Results of a reflection: rows of reflection.csv, and the lines of the table of a command."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.text import engineering
from ..results.finding import Finding
from ..results.row import Values
from .repeat import CLOSED, COMPUTED, OPEN
from .waves import Angles, Scattering

ROOM = 290.0  # [K] temperature of the wires, for their noise
SIDES = ("te", "tm")
NEAR_BEST = 0.02  # [dB] above the least loss, up to which a smaller tension is as good
SHOWN = 3  # frequencies in the table of a run


@dataclass(frozen=True)
class LoadedMesh:
    """A recorded state that reflects."""

    record: int
    strain: tuple[float, float]  # weft, warp
    tension: tuple[float, float]  # [N/m] weft, warp
    load: tuple[float, float] | None = None  # strains or tensions [N/m] of a map
    stress: float = 0.0  # [Pa] largest wire stress


class LossRow(Values):
    """One state at one frequency: a row of reflection.csv. TE and TM are the polarisations of the incident wave."""

    record: int  # number of the record; of a map, of the pair of loads
    strain_weft: float  # strain of the state in weft
    strain_warp: float  # strain of the state in warp
    tension_weft_N_per_m: float  # force per current width in weft
    tension_warp_N_per_m: float  # force per current width in warp
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

    @property
    def mean_tension(self) -> float:
        """[N/m] mean of weft and warp."""
        return 0.5 * float(self.tension_weft_N_per_m + self.tension_warp_N_per_m)


COLUMNS = tuple(LossRow.__annotations__)


def loss_row(state: LoadedMesh, frequency: float, angles: Angles, contacts: str, found: Scattering) -> LossRow:
    """The row of a state at a frequency [Hz] with contacts in a state."""
    lost = np.maximum(1.0 - found.reflected, 0.0)
    powers = {
        "transmitted": found.transmitted,
        "absorbed": found.absorbed,
        "crossed": found.crossed,
        "lobes": found.lobes,
        "ohmic_share": np.divide(found.absorbed, lost, out=np.zeros(2), where=lost > 0.0),
    }
    return LossRow(
        record=state.record,
        strain_weft=state.strain[0],
        strain_warp=state.strain[1],
        tension_weft_N_per_m=state.tension[0],
        tension_warp_N_per_m=state.tension[1],
        frequency_Hz=frequency,
        theta=angles.theta,
        phi=angles.phi,
        contacts=contacts,
        **{f"loss_{side}_dB": float(loss) for side, loss in zip(SIDES, found.loss, strict=True)},
        **{f"{name}_{side}": float(value) for name, both in powers.items() for side, value in zip(SIDES, both, strict=True)},
        **{f"noise_{side}_K": ROOM * float(value) for side, value in zip(SIDES, found.absorbed, strict=True)},
    )


def summary_of(rows: Sequence[LossRow]) -> list[dict[str, float | None]]:
    """The section `reflection` of a summary: an entry for each frequency, with the losses of all states of the contacts."""
    entries = []
    for frequency in sorted({row.frequency_Hz for row in rows}):
        of_state = {row.contacts: row for row in rows if row.frequency_Hz == frequency}
        given = of_state.get(COMPUTED) or next(iter(of_state.values()))
        entry = {name: given[name] for name in COLUMNS[5:] if name != "contacts"}
        for state in (OPEN, CLOSED):
            for side in SIDES:
                other = of_state.get(state)
                entry[f"loss_{state}_{side}_dB"] = None if other is None else other[f"loss_{side}_dB"]
        entries.append(entry)
    return entries


def least_tension(rows: Sequence[LossRow]) -> LossRow | None:
    """The row of the least tension whose loss is within NEAR_BEST of the best, of rows at one frequency; None without tension."""
    tight = [row for row in rows if min(row.tension_weft_N_per_m, row.tension_warp_N_per_m) > 0.0]
    if not tight:
        return None
    best = min(row.loss for row in tight)
    return min((row for row in tight if row.loss <= best + NEAR_BEST), key=lambda row: row.mean_tension)


def shown_frequencies(rows: Sequence[LossRow]) -> list[float]:
    """[Hz] all frequencies, or the first, the middle and the last of more than SHOWN."""
    every = sorted({row.frequency_Hz for row in rows})
    return every if len(every) <= SHOWN else [every[0], every[len(every) // 2], every[-1]]


def reflection_findings(rows: Sequence[LossRow], last: int | None) -> Iterator[Finding]:
    """Lines of the table: the loss of a record and the least tension, for a few of the frequencies.

    last: the record; None: the one of the least tension.
    """
    for frequency in shown_frequencies(rows):
        here = [row for row in rows if row.frequency_Hz == frequency]
        best = least_tension([row for row in here if row.contacts == here[0].contacts])
        record = last if last is not None or best is None else best.record
        if of_state := {row.contacts: row for row in here if row.record == record}:
            yield _loss_finding(frequency, of_state)
        if best is not None:
            where = f", {best.loss:.3g} dB: within {NEAR_BEST:g} dB of the best"
            tension = (float(best.tension_weft_N_per_m), float(best.tension_warp_N_per_m))
            yield Finding("  least tension, weft / warp", tension, "N/m", where=where)


def _loss_finding(frequency: float, of_state: dict[str, LossRow]) -> Finding:
    """The loss of one record at a frequency [Hz]."""
    given = of_state.get(COMPUTED) or next(iter(of_state.values()))
    names = ("warp", "weft") if given.theta == given.phi == 0.0 else ("TE", "TM")
    text = f"{given.loss_te_dB:.3f} dB {names[0]}, {given.loss_tm_dB:.3f} dB {names[1]}"
    others = [(state, of_state[state]) for state in (OPEN, CLOSED) if state in of_state and len(of_state) > 1]
    bounds = "; ".join(f"{state} {row.loss_te_dB:.3g} / {row.loss_tm_dB:.3g}" for state, row in others)
    return Finding(f"reflection loss at {engineering(frequency, 'Hz')}", text, where=f" ({bounds})" if bounds else "")
