"""The one place where open3d is imported, and only when a cloud is to be segmented."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any


@cache
def open3d() -> Any:
    """The module open3d, with the libusb that its wheels link to but do not carry.

    The wheels load `libusb-1.0.so.0`, which many machines lack; loading the copy of
    `libusb-package` into the process first satisfies the linker.
    """
    import libusb_package

    path = libusb_package.get_library_path()
    if path is not None:
        ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    import open3d

    return open3d
