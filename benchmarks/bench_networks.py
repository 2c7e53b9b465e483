"""Measure time and memory of E2VID, FireNet, E-RAFT and our networks here, with random weights.

    python benchmarks/bench_networks.py                  all, at 128 to 1280 px
    python benchmarks/bench_networks.py --widths 1280 --runs 1 --updates 1 --float32

Each line is a separate process: the medians of wall-clock, CPU and system time over the runs after
the first, and its peak memory.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys

import numpy as np
from process_times import times_now

from tasks.learned import cpu

E2VID_OPTIONS = {"num_bins": 5, "num_encoders": 3, "norm": "BN", "use_upsample_conv": False}
NETWORKS = ("e2vid", "firenet", "our_reconstruction", "eraft", "our_flow")
WIDTHS = (128, 240, 346, 640, 1280)


def measure(name: str, width: int, runs: int, updates: int, float32: bool) -> str:
    """Run a network on noise; return a line of the table."""
    import torch

    from tasks.learned.e2vid import E2vidNetwork
    from tasks.learned.e2vid_network import E2vidOptions, E2VIDRecurrent, FireNet
    from tasks.learned.eraft import ERaft
    from tasks.learned.eraft_network import ERAFT
    from tasks.learned.firenet import FireNetNetwork
    from tasks.learned.training.reconstruction import Reconstruction
    from tasks.learned.training.settings import FlowTraining, ReconstructionTraining

    torch.manual_seed(0)
    if float32:
        cpu.has_bfloat16 = lambda: False
    rng = np.random.default_rng(0)
    if name == "e2vid":
        images = E2vidNetwork(E2VIDRecurrent(E2vidOptions(**E2VID_OPTIONS)))
    elif name == "firenet":
        images = FireNetNetwork(FireNet(), name)
    elif name == "our_reconstruction":
        images = E2vidNetwork(Reconstruction(ReconstructionTraining(), "all", 0).network)
    else:
        images = None
        narrower = FlowTraining().narrower if name == "our_flow" else 1
        flows = ERaft(ERAFT(15, narrower), 15)
    bins = (images.bins,) if images else (15, 15)
    grids = [rng.standard_normal((count, width, width), np.float32) for count in bins]
    states = None
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    spent = []
    for _ in range(runs + 1):
        start = times_now()
        if images:
            _, states = images.image(grids[0], states)
        else:
            flows.flow(*grids, updates)
        spent.append(times_now() - start)
    spent = spent[1:] or spent
    wall_s, cpu_s, system_s = np.median([(x.wall_s, x.cpu_s, x.system_s) for x in spent], axis=0)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    kind = "bfloat16" if cpu.has_bfloat16() else "float32"
    return (
        f"{name:18} {width:5} px  {kind:8}  {wall_s:7.2f} s  "
        f"{cpu_s:7.2f} s of CPU, {system_s:.2f} of them system  {most / 2**20:5.2f} GiB, "
        f"{(most - before) / 2**20:5.2f} of them for the run"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--networks", nargs="+", choices=NETWORKS, default=NETWORKS)
    parser.add_argument("--widths", nargs="+", type=int, default=WIDTHS)
    parser.add_argument("--runs", type=int, default=3, help="after the first")
    parser.add_argument("--updates", type=int, default=12, help="of E-RAFT and our flow")
    parser.add_argument("--float32", action="store_true", help="no bfloat16")
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.here:
        asked = options.networks[0], options.widths[0], options.runs, options.updates
        print(measure(*asked, options.float32))
        return
    for name in options.networks:
        for width in options.widths:
            command = [sys.executable, __file__, "--here", "--networks", name, "--widths"]
            command += [str(width), "--runs", str(options.runs), "--updates", str(options.updates)]
            subprocess.run(command + ["--float32"] * options.float32, check=True)


if __name__ == "__main__":
    main()
