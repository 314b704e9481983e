"""What a report says of the process."""

import subprocess
import sys

import numpy as np

from intervis.report import peak_memory


def test_peak_memory_grows_with_what_is_held():
    before = peak_memory()
    held = np.ones(before // 8 + 2**24)  # as much again, and 128 MiB
    assert peak_memory() >= before + 2**26 and peak_memory() >= held.nbytes


def test_peak_memory_is_not_that_of_the_parent():
    held = np.ones(2**26)  # 512 MiB
    script = "from intervis.report import peak_memory; print(peak_memory())"
    child = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert 2**20 < int(child.stdout) < held.nbytes <= peak_memory()
