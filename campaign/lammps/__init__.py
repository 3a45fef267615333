"""The stages of a run in LAMMPS: the same rows, protocol and products as `yade_scripts`, for drained compression.

    packing     the grains: their inertia, the file that LAMMPS reads, the time step they allow
    scene       the scene in LAMMPS commands: law, servo, samples, coming to rest
    stages      the input scripts of consolidation, probe and shear
    outputs     what a run leaves: samples, contacts, snapshots, proofs
    record      the record of a shear run from samples and contacts
    proofs      what a shear run must prove
    runner      starts LAMMPS, on one core or over MPI
    product     the HDF5 file of a run
    protocol    a run from its parameters to its product
    __main__    one row of a table

A module imports only modules above it in this list.  The input scripts stay beside the product, in `<run_id>.lammps/`.
"""
