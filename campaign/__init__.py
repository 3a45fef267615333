"""Plan and run a stochastic DEM campaign: the table of runs, the engines that run it, its status and its results.

A module imports only modules that stand above it in this list:

    files, progress             text and JSON files, digests of code; the progress line
    scope                       what the tool does not do
    config_keys                 every key of the campaign file: default, type, limits, meaning
    config_checks               what several keys must satisfy together; warnings about settings
    config_variables, config    stated distributions in the campaign file; the whole file as one checked value
    folder                      locks, checksums and failure files of a folder
    run_one                     supervises one run of a DEM code (`row`: its former name, for tasks that wait in SLURM)
    plan, cell                  the table of runs and its cost; cells too thin
    choice, prepare             fitted or stated inputs and their points; the files that a campaign starts from
    products, estimate          the status of every run; the work and the time to go
    pace                        the pace of this machine, from the campaigns that ran on it
    batches                     sequential stopping: points in batches until the target error is reached
    engine_local, engine_slurm  run what is missing, on this machine or on a cluster
    status, evaluate            counts and costs; results.h5, tables, figures and report
    sweep_values, sweep         one campaign per value of a key: its settings; shared products, table and figure
    compare, prune              several campaigns side by side, results for other programs; products without a use
    commands                    what each command does
    pythons                     which Python has the packages that are needed
    __main__                    the command line

`yade_scripts` is started, never imported. So is the package `campaign.lammps`, which runs a row in LAMMPS: of these
modules it imports `config`, `files`, `folder` and `run_one` only, and no module imports it. From `analysis` the modules
`errors_and_files` and `quantities`, which need the standard library only, are imported at the top of a module.
Everything else of `analysis`, and numpy, h5py and pandas, is imported inside the function that needs it: these packages
take up to a second to load, which is longer than most commands take, and the supervisor of a run (`run_one`) needs none
of them.
"""

import os

# The campaign only solves small systems, for which several OpenBLAS threads gain nothing. Where all cores are busy with
# runs, the threads wait for each other: a solve with ten unknowns then takes 9 ms instead of 10 us.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
