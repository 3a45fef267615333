"""One run of the DEM: its product file, its states and responses, the compact archive of many runs, VTK export.

Rule: one run at a time, no statistics over runs and no pandas; numpy, scipy, h5py, `micromechanics` and what lies below
it.  All names are imported on first use, so that `peak_critical` can be used without h5py.
"""

from ..errors_and_files import lazy_names

_HOMES = {
    "Archive": ".archive",
    "ArchiveError": ".archive",
    "CriticalState": ".peak_critical",
    "PeakState": ".peak_critical",
    "Run": ".run_file",
    "RunFileError": ".run_file",
    "RunStates": ".states",
    "RunSummary": ".archive",
    "TriaxialError": ".peak_critical",
    "critical_state": ".peak_critical",
    "peak_state": ".peak_critical",
    "read_run": ".run_file",
    "read_snapshot": ".run_file",
    "run_states": ".states",
    "run_summary": ".archive",
    "write_archive": ".archive",
    "write_vtk": ".vtk",
}
__all__ = list(_HOMES)

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
