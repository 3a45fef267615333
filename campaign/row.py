"""Former name of `campaign.run_one`, kept callable: SLURM tasks that wait in a queue start `-m campaign.row`."""

import sys

from campaign.run_one import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
