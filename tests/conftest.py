import mitsuba as mi
import pytest

import intervis  # noqa: F401  (chooses the LLVM and registers the plugins)


@pytest.fixture
def variant_llvm():
    """Run the test in the default variant, whatever a test before it chose."""
    mi.set_variant("llvm_ad_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    return mi.variant()
