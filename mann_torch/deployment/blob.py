"""A deployed controller's whole state as one flat tensor, and as bytes."""

from __future__ import annotations

import hashlib
import math
import struct

import torch
from torch import Tensor

from ..checks import instance
from ..errors import DtypeError, RecordError, ShapeError
from ..trees import leaf_names, leaves, map_tensors, rebuilt
from .tick import Kept

#: What bytes of a state begin with.
MAGIC = b"mannstep"
_WHOLE = {torch.float64: torch.int64, torch.float32: torch.int32}
#: FNV-1a, 64 bits.
_BASIS, _PRIME = 0xCBF29CE484222325, 0x100000001B3


class Blob:
    """The form of a flat state: floating numbers, then integers of their width, then flags.

    A mask is 0 or -1. Bytes are magic (8), what the state belongs to (8), the numbers without flags
    as they lie in memory, and FNV-1a of all before (8), little-endian: those of the C code too.
    """

    def __init__(self, like: Kept, dtype: torch.dtype, told: str) -> None:
        #: What is kept, of any values.
        self.like = like
        self.dtype, self._whole = dtype, _WHOLE[dtype]
        self._shapes = [tuple(x.shape) for x in leaves(like)]
        self._kinds = [
            "f" if x.is_floating_point() else "b" if x.dtype == torch.bool else "i"
            for x in leaves(like)
        ]
        sizes = [math.prod(shape) for shape in self._shapes]
        #: How many floating numbers, and how many others, flags not among them.
        self.n_f = sum(n for n, k in zip(sizes, self._kinds, strict=True) if k == "f")
        self.n_k = sum(sizes) - self.n_f
        #: Numbers of a flat state.
        self.size = self.n_f + self.n_k + 1
        leaf = list(zip(leaf_names(like), self._shapes, self._kinds, strict=True))
        form = f"{told} {dtype} {leaf}"
        #: Eight bytes that say which controller's state it is.
        self.mark = hashlib.sha256(form.encode()).digest()[:8]

    def check(self, state: object) -> Tensor:
        """Raise `KindError`, `ShapeError` or `DtypeError` for what is no flat state like these."""
        flat = instance("state", state, Tensor)
        if flat.shape != (self.size,):
            raise ShapeError(f"state has shape {tuple(flat.shape)}, not ({self.size},)")
        if flat.dtype != self.dtype:
            raise DtypeError(f"state is {flat.dtype}: this stepper takes {self.dtype}")
        return flat

    def packed(self, kept: Kept, flags: int | Tensor = 0) -> Tensor:
        """One flat tensor (size,)."""
        f, k = self.flat(map_tensors(torch.detach, kept))
        return self.joined(f, k, flags)

    def unpacked(self, state: Tensor) -> Kept:
        """The inverse of `packed`, flags left out."""
        return map_tensors(torch.clone, self.tree(*self.split(state)))

    def joined(self, f: Tensor, k: Tensor, flags: int | Tensor = 0) -> Tensor:
        """A flat state of its floating numbers (n_f,) and its others (n_k,)."""
        told = torch.as_tensor(flags, dtype=self._whole).reshape(1)
        return torch.cat([f, torch.cat([k, told]).view(self.dtype)])

    def split(self, state: Tensor) -> tuple[Tensor, Tensor]:
        """The inverse of `joined`, flags left out."""
        return state[: self.n_f], state[self.n_f : -1].view(self._whole)

    def zeros(self) -> tuple[Tensor, Tensor]:
        """Of the form of `split`."""
        return torch.zeros(self.n_f, dtype=self.dtype), torch.zeros(self.n_k, dtype=self._whole)

    def flat(self, kept: Kept) -> tuple[Tensor, Tensor]:
        """What is kept as floating numbers (n_f,) and others (n_k,); it can be traced."""
        pairs = list(zip((x.reshape(-1) for x in leaves(kept)), self._kinds, strict=True))
        sign = {"b": -1, "i": 1}
        whole = [sign[k] * x.to(self._whole) for x, k in pairs if k != "f"]
        return torch.cat([x.to(self.dtype) for x, k in pairs if k == "f"]), torch.cat(whole)

    def tree(self, f: Tensor, k: Tensor) -> Kept:
        """The inverse of `flat`."""
        parts, at = [], {"f": 0, "k": 0}
        for shape, kind in zip(self._shapes, self._kinds, strict=True):
            array, source = ("f", f) if kind == "f" else ("k", k)
            end = at[array] + math.prod(shape)
            value = source[at[array] : end].reshape(shape)
            parts.append(value if kind == "f" else value != 0 if kind == "b" else value.long())
            at[array] = end
        return rebuilt(self.like, parts)

    def flags(self, state: Tensor) -> int:
        """Of the tick that gave this state."""
        return int(state.view(self._whole)[-1])

    def to_bytes(self, state: Tensor) -> bytes:
        """The state as bytes."""
        body = MAGIC + self.mark + state[:-1].numpy().tobytes()
        return body + struct.pack("<Q", checksum(body))

    def from_bytes(self, data: bytes) -> Tensor:
        """The inverse of `to_bytes`. Raises `RecordError` for what is no such state."""
        width = 16 + (self.size - 1) * self.dtype.itemsize + 8
        if len(data) != width or data[:8] != MAGIC:
            raise RecordError(f"no state of this controller: {len(data)} bytes, it has {width}")
        if data[8:16] != self.mark:
            raise RecordError("the state of another controller, period or precision")
        if struct.unpack("<Q", data[-8:])[0] != checksum(data[:-8]):
            raise RecordError("the state is damaged: its checksum is another one")
        numbers = torch.frombuffer(bytearray(data[16:-8]), dtype=self.dtype)
        return torch.cat([numbers, torch.zeros(1, dtype=self._whole).view(self.dtype)])


def checksum(data: bytes) -> int:
    """FNV-1a of bytes."""
    found = _BASIS
    for byte in data:
        found = (found ^ byte) * _PRIME & 0xFFFFFFFFFFFFFFFF
    return found
