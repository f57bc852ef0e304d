import os

import drjit
import mitsuba as mi


def select_variant(rgb=False):
    """True: compiled by LLVM, of the version that `conftest` chose."""
    llvm = "DRJIT_LIBLLVM_PATH" in os.environ and drjit.has_backend(drjit.JitBackend.LLVM)
    mi.set_variant("scalar_rgb" if not llvm else "llvm_ad_rgb" if rgb else "llvm_ad_mono")
    return llvm
