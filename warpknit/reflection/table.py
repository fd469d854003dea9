"""Results of a reflection: rows of reflection.csv, and the lines of the table of a command."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..base.text import engineering, sides_text
from ..results.finding import Finding
from ..results.row import Values
from .repeat import CLOSED, COMPUTED, OPEN
from .waves import Angles, Scattering

ROOM = 290.0  # [K] temperature of the wires, for their noise
SIDES = ("te", "tm")
NEAR_BEST = 0.02  # [dB] by which losses from the least tension on may differ
SAME = 1e-3  # of a tension: two searches for the same tension differ by less
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

    @property
    def tension(self) -> tuple[float, float]:
        """[N/m] in weft and warp."""
        return self.tension_weft_N_per_m, self.tension_warp_N_per_m


class LeastTension(Values):
    """Least tension that reflects as well as all greater ones; null without one. Up to the elastic limit."""

    frequency_Hz: float  # frequency of the wave
    tension_weft_N_per_m: float | None  # least mean tension of weft and warp above which the losses of all records lie within
    # 0.02 dB, for the worse polarisation, up to the elastic limit; null without one
    tension_warp_N_per_m: float | None  # the same in warp
    loss_dB: float | None  # reflection loss at this tension, of the worse polarisation


COLUMNS = tuple(LossRow.__annotations__)


def loss_row(state: LoadedMesh, frequency: float, angles: Angles, contacts: str, found: Scattering) -> LossRow:
    """Row of a state at a frequency [Hz], with contacts in a state."""
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
        stress_max_Pa=state.stress,
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
        entry = {name: given[name] for name in COLUMNS[COLUMNS.index("frequency_Hz") :] if name != "contacts"}
        for state in (OPEN, CLOSED):
            for side in SIDES:
                other = of_state.get(state)
                entry[f"loss_{state}_{side}_dB"] = None if other is None else other[f"loss_{side}_dB"]
        entries.append(entry)
    return entries


def least_tensions(rows: Sequence[LossRow], limit: float) -> list[LeastTension]:
    """The entries `reflection` of the answers; limit: [Pa] elastic limit of the wire."""
    entries = []
    for frequency in sorted({row.frequency_Hz for row in rows}):
        least = least_tension(given_rows(rows, frequency), limit)
        weft, warp, loss = (None, None, None) if least is None else (*least.tension, least.loss)
        entries.append(LeastTension(frequency_Hz=frequency, tension_weft_N_per_m=weft, tension_warp_N_per_m=warp, loss_dB=loss))
    return entries


def least_tension(rows: Sequence[LossRow], limit: float) -> LossRow | None:
    """Row of the least tension with loss within NEAR_BEST from there on; rows at one frequency.

    Counted are rows with tension and a stress up to the limit [Pa]. The losses of those whose tensions in weft and warp are
    not smaller lie within NEAR_BEST of each other. One row alone shows nothing. None if there is no such tension.
    """
    tight = [row for row in rows if min(row.tension) > 0.0 and row.stress_max_Pa <= limit]
    tension, loss = np.array([row.tension for row in tight]).reshape(-1, 2), np.array([row.loss for row in tight])
    for k in np.argsort(tension.sum(axis=1)):
        onwards = loss[(tension >= (1.0 - SAME) * tension[k]).all(axis=1)]
        if len(onwards) > 1 and np.ptp(onwards) <= NEAR_BEST:
            return tight[k]
    return None


def given_rows(rows: Sequence[LossRow], frequency: float) -> list[LossRow]:
    """Rows at a frequency [Hz] with contacts as computed, or as the scene sets."""
    return [row for row in rows if row.frequency_Hz == frequency and row.contacts == rows[0].contacts]


def shown_record(rows: Sequence[LossRow], frequency: float, limit: float, is_map: bool) -> int:
    """The last record; of a map, at the least tension at a frequency [Hz]."""
    least = least_tension(given_rows(rows, frequency), limit) if is_map else None
    return int((least or rows[-1]).record)


def shown_frequencies(rows: Sequence[LossRow]) -> list[float]:
    """All frequencies [Hz], or first, middle and last of more than SHOWN."""
    every = sorted({row.frequency_Hz for row in rows})
    return every if len(every) <= SHOWN else [every[0], every[len(every) // 2], every[-1]]


def reflection_findings(rows: Sequence[LossRow], limit: float, is_map: bool) -> Iterator[Finding]:
    """Rows of the table: the loss of a record and the least tension, for a few of the frequencies."""
    for frequency in shown_frequencies(rows):
        record = shown_record(rows, frequency, limit, is_map)
        of_state = {row.contacts: row for row in rows if (row.record, row.frequency_Hz) == (record, frequency)}
        given = of_state.get(COMPUTED) or next(iter(of_state.values()))
        least = least_tension(given_rows(rows, frequency), limit)
        from_ = (
            f"least tension {sides_text(least.tension, 'N/m')}"
            if least
            else f"no least tension: larger tensions still change it by more than {NEAR_BEST:g} dB"
        )
        name = f"reflection {engineering(frequency, 'Hz')}"
        yield Finding(name, f"loss {_losses(given)}; {from_}", short=True)
        for state in (OPEN, CLOSED):
            if state in of_state and len(of_state) > 1:
                yield Finding(f"  contacts {state}", _losses(of_state[state]))
        if least:
            yield Finding("  least tension", f"{least.loss:.3g} dB; within {NEAR_BEST:g} dB at larger tensions")


def _losses(row: LossRow) -> str:
    """The losses of both polarisations."""
    names = ("warp", "weft") if row.theta == row.phi == 0.0 else ("TE", "TM")
    return f"{row.loss_te_dB:.3f} dB {names[0]}, {row.loss_tm_dB:.3f} dB {names[1]}"
