"""A Warp kernel around a native text. (Warp reads annotations as types: no future import here.)"""

from typing import Any

import warp as wp


def declare(name: str, text: str, options: dict[str, Any]) -> Any:
    """A kernel over groups of lanes; `text` is a function's body of (table, g, first, last)."""
    body = "const unsigned long long* const table = (const unsigned long long*)pointers.data;\n"

    @wp.func_native(body + text)
    def native(pointers: wp.array(dtype=wp.int64), g: int, first: int, last: int):  # type: ignore[valid-type]
        ...

    @wp.kernel(module="unique", name=name, enable_backward=False, module_options=options)
    def march(pointers: wp.array(dtype=wp.int64), offset: int, first: int, last: int):  # type: ignore[valid-type]
        native(pointers, wp.tid() + offset, first, last)

    return march
