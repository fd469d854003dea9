"""How this process was started: alone, or as a rank by a launcher such as mpirun."""

from __future__ import annotations

import os

from ..errors import InputError
from .ranks import One, Ranks

# what the launchers of MPICH, Open MPI, PMIx and MVAPICH tell a process: its rank
RANK_VARIABLES = ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "PMIX_RANK", "MV2_COMM_WORLD_RANK")
SIZE_VARIABLES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE")


def join_ranks() -> Ranks:
    """The ranks that this process was started among. Raises `InputError` where that needs mpi4py and it is missing."""
    if started_as() is None or any(os.environ.get(name) == "1" for name in SIZE_VARIABLES):
        return One()
    try:
        from .mpi import Mpi
    except ImportError as error:
        raise InputError(
            f'several ranks need mpi4py and an MPI library ({error}); pip install "warpknit[mpi]", or run without mpirun'
        ) from error
    ranks = Mpi()
    if ranks.count == 1:
        return One()
    share_cores(ranks)
    return ranks


def started_as() -> int | None:
    """The rank that a launcher gave this process, None where none started it."""
    return next((int(os.environ[name]) for name in RANK_VARIABLES if os.environ.get(name, "").isdecimal()), None)


def share_cores(ranks: Ranks) -> None:
    """Give every rank on a machine its share of the cores for its threads, where nobody has said how many (step.thread_count)."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    # a launcher may have bound each rank to its own cores
    sharing = min(ranks.neighbours, ranks.everyone(cores).count(cores))
    os.environ.setdefault("WARPKNIT_THREADS", str(max(1, len(cores) // sharing)))
