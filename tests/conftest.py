import intervis  # noqa: F401, I001  (first: it names a good LLVM before Dr.Jit loads one)

import mitsuba as mi
import pytest


@pytest.fixture
def variant_llvm():
    """Run the test in the default variant, whatever a test before it chose."""
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    return mi.variant()
