#!/usr/bin/env bash
# Times PyTorch 2.6 and this crate on the same machine, one after the other: `bash benches/compare.sh [threads] [filter]`.
set -euo pipefail
cd "$(dirname "$0")/.."
threads=${1:-2}
filter=${2:-}
python=target/pytorch/bin/python
if ! "$python" -c 'import torch' 2>/dev/null; then
    python3 -m venv target/pytorch
    "$python" -m pip install --quiet numpy
    "$python" -m pip install --quiet torch==2.6.0 --index-url https://download.pytorch.org/whl/cpu ||
        "$python" -m pip install --quiet torch==2.6.0
fi
OMP_WAIT_POLICY=passive "$python" benches/pytorch.py "$threads" "target/pytorch-$threads.json" "$filter"
cargo bench --quiet --bench core -- "$threads" "$filter"
