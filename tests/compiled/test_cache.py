"""Whatever happens to kernels on disk, the result is right."""

from __future__ import annotations

import errno
import logging
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch
import warp as wp
import warp._src.build as warp_build

from mann_torch.compiled.host import cache
from mann_torch.compiled.host import kernels as host
from mann_torch.errors import KernelError

TEXT = "{ long long* out = (long long*)table[0]; out[g] = 42 + first; }"


class Kept:
    """A cache of its own, and how often something was compiled."""

    def __init__(self, root: Path) -> None:
        self.root, self.compiled = root, 0
        self.meanwhile: Callable[[], object] = lambda: None

    @property
    def folder(self) -> Path:
        (found,) = (p for p in self.root.iterdir() if p.suffix != ".lock")
        return found

    def file(self, suffix: str) -> Path:
        (found,) = self.folder.glob(f"*{suffix}")
        return found

    def use(self, text: str = TEXT) -> None:
        """As in a new process: built or loaded from disk, and right."""
        host._build.cache_clear()
        for module in list(wp._src.context.user_modules.values()):
            if module.name.startswith("march_"):
                module.unload()
        out = torch.zeros(2, dtype=torch.int64)
        host.kernel(text, 1).prepared(torch.tensor([out.data_ptr()]), 0, 2)(7, 0)
        assert out.tolist() == [49, 49]


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Kept]:
    if host.missing() is not None:
        pytest.skip("no Warp here")
    made = Kept(tmp_path / "cache")
    real = warp_build.build_cpu

    def counted(*arguments: object, **options: object) -> None:
        made.compiled += 1
        made.meanwhile()
        real(*arguments, **options)

    monkeypatch.setattr(warp_build, "build_cpu", counted)
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(made.root))
    cache._say.cache_clear()
    yield made
    host._build.cache_clear()


def garble(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def fill(path: Path) -> None:
    path.unlink()
    path.mkdir()


def blank(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize("damage", [Path.unlink, blank, halve, garble, fill])
@pytest.mark.parametrize("suffix", [".o", ".meta", ".cpp", "seal.json"])
def test_a_damaged_file_is_made_again(
    kept: Kept, suffix: str, damage: Callable[[Path], None]
) -> None:
    kept.use()
    damage(kept.file(suffix))
    kept.use()
    assert kept.compiled == 2
    kept.use()
    assert kept.compiled == 2


@pytest.mark.parametrize("seal", ["[]", "{}", "7", "null", '{"a": 1}', "[" * 100_000])
def test_a_seal_of_another_form_does_not_count(kept: Kept, seal: str) -> None:
    kept.use()
    kept.file("seal.json").write_text(seal)
    kept.use()
    assert kept.compiled == 2


def test_folders_that_go_or_turn_into_files(kept: Kept) -> None:
    kept.use()
    folder = kept.folder
    for number, put in enumerate(
        (
            lambda: None,
            lambda: folder.write_text("a file"),
            lambda: folder.symlink_to("/nowhere"),
            lambda: folder.mkdir(),
            lambda: shutil.rmtree(kept.root),
        )
    ):
        shutil.rmtree(folder)
        put()
        kept.use()
        kept.use()
        assert kept.compiled == 2 + number


def test_without_a_lock_it_goes_on(kept: Kept) -> None:
    kept.use()
    lock = kept.folder.with_name(kept.folder.name + ".lock")
    lock.unlink()
    lock.mkdir()
    kept.use()
    assert kept.compiled == 1
    shutil.rmtree(kept.folder)
    kept.use()
    assert kept.compiled == 2


def test_the_cache_may_go_while_something_is_compiled(kept: Kept) -> None:
    kept.meanwhile = lambda: shutil.rmtree(kept.root, ignore_errors=True)
    for number in range(3):
        kept.use(TEXT + f"/* {number} */")
    assert kept.compiled == 3 and Path(wp.config.kernel_cache_dir) == kept.root


def test_files_of_another_processor_stay(kept: Kept) -> None:
    kept.use()
    folder = kept.folder
    (own,) = folder.glob("*.o")
    other = own.with_name("of_another.o")
    own.rename(other)
    files = cache._files(folder)
    (folder / "seal.json").write_text(cache.json.dumps(cache._hashes(files)))
    kept.use()
    kept.use()
    assert kept.compiled == 2 and other.exists() and own.exists()


def test_a_full_disk_is_told_once_and_not_remembered(
    kept: Kept, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    full = OSError(errno.ENOSPC, "No space left on device")

    def refuse(*_: object) -> None:
        raise full

    with monkeypatch.context() as patch, caplog.at_level(logging.WARNING, "mann_torch"):
        patch.setattr(cache, "_fill", lambda folder, files: refuse() if files else None)
        kept.use()
        kept.use(TEXT + "/* another */")
    assert len(caplog.records) == 1 and "No space left" in caplog.text
    real = cache._with_room
    with monkeypatch.context() as patch:  # the temporary folder alone is full
        patch.setattr(
            cache,
            "_with_room",
            lambda folder, need: (
                real(folder, need) if folder.is_relative_to(kept.root) else refuse()
            ),
        )
        kept.use()
        patch.setattr(cache, "_with_room", refuse)
        with pytest.raises(KernelError, match="No space left"):
            kept.use(TEXT + "/* a third */")
    kept.use(TEXT + "/* a third */")


def test_what_the_compiler_refuses_is_not_tried_twice(kept: Kept) -> None:
    wrong = "{ this is no C++ }"
    for _ in range(2):
        with pytest.raises(KernelError, match="cannot be built"):
            host.kernel(wrong, 1)
    assert kept.compiled == 1
    kept.use()


def test_what_is_old_goes(kept: Kept) -> None:
    kept.use()
    old = time.time() - 2 * cache.UNUSED
    unused, left = kept.root / "wp_march_0", kept.root / f"{cache.OWN}0"
    strange, used = kept.root / "wp_other_0", kept.folder
    for folder in (unused, left, strange):
        folder.mkdir()
        os.utime(folder, (old, old))
    os.utime(used / "seal.json", (old, old))
    kept.use()  # marks its use
    cache._tidy.cache_clear()
    kept.use(TEXT + "/* new */")
    assert used.exists() and strange.exists()
    assert not unused.exists() and not left.exists()


START = f"""
import os, signal, sys, time, torch
from mann_torch.compiled.host import kernels as host
import warp as wp, warp._src.build as warp_build

def child(slow=False):
    number = os.fork()
    if number:
        return number
    real, compiled = warp_build.build_cpu, []
    def counted(*a, **k):
        compiled.append(1)
        real(*a, **k)
        if slow:
            os.write(1, b"compiling\\n")
            time.sleep(60)
    warp_build.build_cpu = counted
    out = torch.zeros(2, dtype=torch.int64)
    host.kernel({TEXT!r}, 1).prepared(torch.tensor([out.data_ptr()]), 0, 2)(7, 0)
    os.write(1, f"{{out.tolist()}} {{len(compiled)}}\\n".encode())
    os._exit(0)

def ends(numbers):
    return all(os.waitpid(n, 0)[1] == 0 for n in numbers)
"""


def lines_of(code: str, folder: str | Path) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-c", START + code],
        capture_output=True,
        text=True,
        env={**os.environ, "WARP_CACHE_PATH": str(folder)},
    )
    assert done.returncode == 0, done.stderr
    return (done.stdout + done.stderr).splitlines()


@pytest.mark.slow
def test_many_processes_compile_once_and_a_killed_one_disturbs_none(tmp_path: Path) -> None:
    code = """
assert ends([child() for _ in range(20)])
os.environ["WARP_CACHE_PATH"] += "/other"
read, write = os.pipe()
kept = os.dup(1)
os.dup2(write, 1)
first = child(slow=True)
os.read(read, 1)
os.dup2(kept, 1)
os.kill(first, signal.SIGKILL)
os.waitpid(first, 0)
assert ends([child()]) and ends([child()])
"""
    found = lines_of(code, tmp_path)
    assert sorted(found[:20]) == ["[49, 49] 0"] * 19 + ["[49, 49] 1"]
    assert found[20:] == ["[49, 49] 1", "[49, 49] 0"]
    for folder in (tmp_path, tmp_path / "other"):  # the user's choice
        assert len(list((folder / wp.config.version).glob("wp_march_*/seal.json"))) == 1


def test_an_unwritable_home_is_told_in_one_line() -> None:
    code = """
out = torch.zeros(2, dtype=torch.int64)
host.kernel(TEXT, 1).prepared(torch.tensor([out.data_ptr()]), 0, 2)(7, 0)
print(out.tolist(), wp.config.kernel_cache_dir)
""".replace("TEXT", repr(TEXT))
    said, printed = sorted(lines_of(code, "/dev/null/nothing"), reverse=True)
    folder = printed.removeprefix("[49, 49] ")
    assert said.startswith("no kernels can be kept") and str(Path(folder).parent) in said
    assert folder.startswith(tempfile.gettempdir()) and not Path(folder).parent.exists()


@pytest.mark.slow
def test_a_disk_that_is_really_full(tmp_path: Path) -> None:
    for size in (4, 16):  # [KiB]: nothing fits, or a part
        room = tmp_path / str(size)
        room.mkdir()
        mount = ["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", str(room)]
        if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
            pytest.skip("needs the right to mount")
        try:
            found = lines_of("assert ends([child()]) and ends([child()])", room)
        finally:
            subprocess.run(["umount", str(room)], check=True)
        assert [line for line in found if line.startswith("[49")] == ["[49, 49] 1"] * 2


@pytest.mark.slow
def test_the_folder_of_a_killed_process_goes_with_the_next_and_a_living_ones_stays(
    tmp_path: Path,
) -> None:
    script = (
        "import os, sys, time\n"
        "from mann_torch.compiled.host.cache import temporary_folder\n"
        "print(temporary_folder(os.getpid()), flush=True)\n"
        "time.sleep(60)\n"
    )

    def begun() -> tuple[subprocess.Popen[str], Path]:
        process = subprocess.Popen(
            [sys.executable, "-c", script],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "TMPDIR": str(tmp_path)},
        )
        assert process.stdout is not None
        return process, Path(process.stdout.readline().strip())

    (killed, left), (living, kept) = begun(), begun()
    try:
        killed.kill()
        killed.wait()
        assert left.is_dir()
        following, own = begun()
        assert not left.exists() and kept.is_dir() and own.is_dir()
        following.kill()
    finally:
        for process in (killed, living):
            process.kill()
            process.wait()
