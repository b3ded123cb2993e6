# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays met, kept for later solves of the same geometry with other lights."""

import contextlib
import copy
import hashlib
import json
import os
import secrets
import zipfile
import zlib
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import Error
from .scene import Scene

#: Of the file. Another number is another layout, which is refused.
VERSION = 5
#: Bytes of a digest.
DIGEST = 16
#: What is left of light is told in so many steps.
SHARE_STEPS = 1 << 15
_ROW = np.dtype([("digest", np.uint8, DIGEST), ("size", np.int64)])


class KeptVisibility:
    """The answers of rays, packed, by a digest of the rays themselves and of the geometry.

    What is not kept is traced: other output points or settings ask other rays, and only those are new. Give one object
    to `solve` again and again, or `save` it and `load` it in another process.

    unsaved    whether there is anything in it that the file it was loaded from or saved to does not have
    cuts       which patches were cut by bright spots of lamps, one time after the other; None before that is known
    """

    def __init__(self) -> None:
        self._geometry = b""
        self._emission, self._albedo = np.zeros((0, 3)), np.zeros((0, 3))
        self._answers: dict[bytes, bytes] = {}
        # Those of a file that nobody has asked for yet: they are not saved again.
        self._loaded: dict[bytes, bytes] = {}
        self._lock = Lock()
        self.unsaved = True
        self.cuts: list[NDArray[np.int64]] | None = None

    def take(self, scene: Scene) -> list[str]:
        """Makes it that of a scene; a warning where what it held is of no use."""
        geometry, empty = _digest(scene), not self._geometry
        if self._geometry == geometry and len(self._emission) == len(scene.triangles):
            # What this solve does not ask for goes with the next one.
            self._loaded, self._answers = self._answers or self._loaded, {}
            return []
        self._answers, self._loaded, self._geometry = {}, {}, geometry
        self.remake(scene)
        return [] if empty else ["the kept visibility is of other geometry and is computed anew"]

    def remake(self, scene: Scene) -> list[str]:
        """From now on particles are those of this scene's lights; a warning."""
        self._emission, self._albedo = scene.emission, scene.albedo
        self.unsaved, self.cuts = True, None
        return ["the kept visibility is of other emitters or albedos and is computed anew"]

    def first(self, scene: Scene) -> Scene:
        """The scene with the lights for which its particles were made."""
        first = copy.copy(scene)
        first.emission, first.albedo = self._emission, self._albedo
        return first

    def around(self, tracer: Any) -> "Replaying":
        """An embree scene that is asked only for what is not kept."""
        return Replaying(tracer, self, self._geometry)

    def find(self, digest: bytes) -> bytes | None:
        """What is kept under a digest, or None."""
        with self._lock:
            packed = self._answers.get(digest) or self._loaded.pop(digest, None)
            if packed is None:
                return None
            self._answers[digest] = packed
        try:
            return zlib.decompress(packed)
        except zlib.error:
            return None

    def keep(self, digest: bytes, answer: bytes) -> None:
        """Keeps an answer."""
        packed = zlib.compress(answer, 1)
        with self._lock:
            self._answers[digest] = packed
            self.unsaved = True

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the file, whole or not at all. Raises `Error` naming the path where that cannot be done."""
        path = Path(os.path.realpath(path))
        temporary = path.with_name(f".{secrets.token_hex(8)}.tmp")
        try:
            self._write(temporary)
            os.replace(temporary, path)
        except OSError as error:
            raise Error(f"cannot write '{path}': {error.strerror or error}") from None
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
        self.unsaved = False

    def _write(self, path: Path) -> None:
        with self._lock:
            answers = dict(self._answers)
        rows = np.zeros(len(answers), _ROW)
        for row, (digest, packed) in zip(rows, answers.items(), strict=True):
            row["digest"], row["size"] = np.frombuffer(digest, np.uint8), len(packed)
        cuts = self.cuts or []
        about = {"geometry": self._geometry.hex(), "triangles": len(self._emission), "cuts": [*map(len, cuts)]}
        with zipfile.ZipFile(path, "x", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            archive.writestr("version", str(VERSION))
            archive.writestr("about", json.dumps(about))
            archive.writestr("lights", np.stack([self._emission, self._albedo]).tobytes())
            archive.writestr("cuts", b"".join(cut.tobytes() for cut in cuts))
            archive.writestr("rows", rows.tobytes())
            # They are packed already.
            archive.writestr("answers", b"".join(answers.values()), zipfile.ZIP_STORED)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "KeptVisibility":
        """Reads a file; raises `Error`, in one line naming it, where it is missing, damaged or of another version."""
        try:
            with zipfile.ZipFile(path) as archive:
                version = archive.read("version").decode("ascii")
                if version != str(VERSION):
                    raise Error(f"kept visibility '{path}' has version {version!r}, expected {VERSION}")
                return cls._read({name: archive.read(name) for name in ("about", "lights", "cuts", "rows", "answers")})
        except (Error, MemoryError):
            raise
        except OSError as error:
            raise Error(f"cannot read '{path}': {error.strerror or error}") from None
        except Exception as error:
            # A zip can be damaged in many ways, each with an exception of its own.
            why = " ".join(str(error).split()) or type(error).__name__
            raise Error(f"kept visibility '{path}' is damaged: {why}") from None

    @classmethod
    def _read(cls, parts: dict[str, bytes]) -> "KeptVisibility":
        kept, about = cls(), json.loads(parts["about"])
        kept._geometry = bytes.fromhex(about["geometry"])
        kept._emission, kept._albedo = np.frombuffer(parts["lights"]).reshape(2, about["triangles"], 3)
        kept.cuts = np.split(np.frombuffer(parts["cuts"], np.int64), np.cumsum(about["cuts"]))[:-1]
        rows = np.frombuffer(parts["rows"], _ROW)
        ends = np.cumsum(rows["size"])
        if len(kept._geometry) not in (0, DIGEST) or (ends[-1] if len(ends) else 0) != len(parts["answers"]):
            raise ValueError("its parts do not belong together")
        starts, answers = ends - rows["size"], parts["answers"]
        for row, start, end in zip(rows, starts.tolist(), ends.tolist(), strict=True):
            kept._loaded[row["digest"].tobytes()] = answers[start:end]
        kept.unsaved = False
        return kept


class Replaying:
    """Stands in for an embree scene: the same `run`, for the questions of `visibility.py`.

    replayed   rays answered without tracing them, so far
    """

    def __init__(self, tracer: Any, kept: KeptVisibility, geometry: bytes) -> None:
        self._tracer, self._kept, self._geometry = tracer, kept, geometry
        self._lock = Lock()
        self.replayed = 0

    def run(
        self,
        origins: NDArray[np.float32],
        directions: NDArray[np.float32],
        dists: NDArray[np.float32] | None = None,
        query: str = "INTERSECT",
        output: bool = False,
    ) -> Any:
        """As that of embreex; of all that it may return, what `visibility.py` reads."""
        question = hashlib.blake2b(f"{query} {output}".encode(), digest_size=DIGEST, key=self._geometry)
        for array in (origins, directions, dists):
            question.update(b"" if array is None else np.ascontiguousarray(array).data)
        digest, count = question.digest(), len(origins)
        unpacked = _unpack(self._kept.find(digest), count, query, output)
        if unpacked is not None:
            with self._lock:
                self.replayed += count
            return unpacked
        met = self._tracer.run(origins, directions, dists=dists, query=query, output=output)
        self._kept.keep(digest, _pack(met, query, output))
        return met


def _pack(met: Any, query: str, output: bool) -> bytes:
    if output:
        places = (met[name].astype(np.float32) for name in ("u", "v"))
        return b"".join(part.tobytes() for part in (met["primID"].astype(np.int32), *places))
    if query == "TRANSMITTED":
        return np.round(np.clip(met, 0, 1) * np.float32(SHARE_STEPS)).astype(np.uint16).tobytes()
    return np.packbits(met == 0).tobytes() if query == "OCCLUDED" else met.astype(np.int32).tobytes()


def _unpack(answer: bytes | None, count: int, query: str, output: bool) -> Any:
    """What `_pack` packed for so many rays; None where it is something else."""
    sizes = {"OCCLUDED": (count + 7) // 8, "TRANSMITTED": 2 * count}
    expected = 12 * count if output else sizes.get(query, 4 * count)
    if answer is None or len(answer) != expected:
        return None
    if output:
        u, v = np.frombuffer(answer, np.float32, offset=4 * count).reshape(2, count)
        return {"primID": np.frombuffer(answer, np.int32, count), "u": u, "v": v}
    if query == "OCCLUDED":
        return np.unpackbits(np.frombuffer(answer, np.uint8), count=count).astype(np.int32) - 1
    if query == "TRANSMITTED":
        return np.frombuffer(answer, np.uint16) / np.float32(SHARE_STEPS)
    return np.frombuffer(answer, np.int32)


def _digest(scene: Scene) -> bytes:
    found = hashlib.blake2b(digest_size=DIGEST)
    opacity = scene.opacity.arrays() if scene.opacity is not None else ()
    for array in (scene.triangles, scene.two_sided, *opacity):
        found.update(repr(array.shape).encode())
        found.update(np.ascontiguousarray(array).data)
    return found.digest()
