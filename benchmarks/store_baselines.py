"""Store the rows of baselines of the touch benchmark, from folders of `lis-grasp benchmark`."""

from __future__ import annotations

import sys
from pathlib import Path

from lis_grasp_studies.benchmark.baselines import store_baselines
from lis_grasp_studies.benchmark.protocol import Protocol
from lis_grasp_studies.harness.program import exit_code, read_options


def main() -> int:
    folders = [Path(name) for name in read_options(__doc__, objects=[""]).objects]

    def store() -> None:
        print(f"{store_baselines(Protocol.load(), folders)} rows stored")

    return exit_code("store_baselines", store)


if __name__ == "__main__":
    sys.exit(main())
