#!/usr/bin/env bash
# The material point method here, in NVIDIA Warp 1.19 and in Taichi 1.7.4 on the CPU, one after the other:
# `bash models/benches/mpm.sh [threads] [particles]`. Both peers are put under target/ once. Warp's CPU kernels use one
# thread; its line for one serves any number.
set -euo pipefail
cd "$(dirname "$0")/../.."
threads=${1:-1}
particles=${2:-20000}
python=target/mpm-peers/bin/python
if ! "$python" -c 'import warp, taichi' 2>/dev/null; then
    python3 -m venv target/mpm-peers
    "$python" -m pip install --quiet numpy warp-lang==1.19.0 taichi==1.7.4
fi
"$python" models/benches/mpm_peers.py warp 1 "$particles" | grep particles
"$python" models/benches/mpm_peers.py taichi "$threads" "$particles" | grep particles || echo "taichi failed"
cargo bench --quiet -p gradreel-models --bench mpm -- "$threads" "$particles"
