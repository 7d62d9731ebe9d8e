# Sourced by the scripts that compare: puts PyTorch 2.6 under target/ once, and its interpreter in $python.
python=target/pytorch/bin/python
if ! "$python" -c 'import torch' 2>/dev/null; then
    python3 -m venv target/pytorch
    "$python" -m pip install --quiet numpy
    "$python" -m pip install --quiet torch==2.6.0 --index-url https://download.pytorch.org/whl/cpu ||
        "$python" -m pip install --quiet torch==2.6.0
fi
# threads that spin while they wait would be several times slower on small virtual machines: no honest baseline
export OMP_WAIT_POLICY=passive
