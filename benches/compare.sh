#!/usr/bin/env bash
# Times PyTorch 2.6 and this crate on the same machine, one after the other: `bash benches/compare.sh [threads] [filter]`.
set -euo pipefail
cd "$(dirname "$0")/.."
threads=${1:-2}
filter=${2:-}
source benches/install_pytorch.sh
"$python" benches/pytorch.py "$threads" "target/pytorch-$threads.json" "$filter"
cargo bench --quiet --bench core -- "$threads" "$filter"
