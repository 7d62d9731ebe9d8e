#!/usr/bin/env bash
# Times the networks of the multi-view model at their published sizes, in PyTorch 2.6 and here, one after the other:
# `bash models/benches/compare.sh [threads] [filter]`. Takes some 10 GB of memory.
set -euo pipefail
cd "$(dirname "$0")/../.."
threads=${1:-2}
filter=${2:-}
source benches/install_pytorch.sh
"$python" models/benches/views_pytorch.py "$threads" "target/pytorch-views-$threads.json" "$filter"
cargo bench --quiet -p gradreel-models --bench views -- "$threads" "$filter"
