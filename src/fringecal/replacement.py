"""Replacing a folder of results in one step, so that whoever looks finds the old ones whole or the new ones whole.

New results are gathered in a hidden folder beside, together with what stays of the old ones, and exchanged with the
folder by one call of the system (`renameat2` with ``RENAME_EXCHANGE`` on Linux, `renamex_np` with ``RENAME_SWAP`` on
macOS). Where there is no such call, or the folder may not be moved (a mount, the working directory), files are moved
one by one from a folder whose name says that everything in it is wanted: if that is broken off, the next command
completes it. What is hidden carries its owner's name (host, boot, process and when that began), by which the next
command tells what was left behind from what is at work.
"""

import contextlib
import ctypes
import errno
import functools
import glob
import hashlib
import os
import re
import secrets
import shutil
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ABANDONED_S = 24 * 3600.0
"""Age in s of what another host left, whose processes cannot be seen from here; nothing works so long at results."""

PARTIAL, MOVING = "partial", "moving"
"""Endings of hidden names: what is being gathered, and what is complete and on its way into the folder."""

_AT_FDCWD, _EXCHANGE = -100, 2  # linux/fcntl.h, linux/fs.h; RENAME_SWAP of macOS is 2 as well
_NOT_HERE = {errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EBUSY, errno.EXDEV, errno.EPERM}
_DEFERRED = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


_PUT: list[Path] = []


@dataclass(frozen=True)
class Owner:
    """Whose a hidden name is: host (with its namespace of processes), boot, process, and when the process began."""

    host: str
    boot: str
    process: int
    began: str

    @classmethod
    def of_this_process(cls) -> "Owner":
        """Return this process."""
        return cls(_host(), _boot(), os.getpid(), _began(os.getpid()))

    @classmethod
    def parsed(cls, text: str) -> "Owner | None":
        """Read an owner from a hidden name; None where there is none, as in those of older versions."""
        parts = text.split("-")
        return cls(parts[0], parts[1], int(parts[2]), parts[3]) if len(parts) == 4 and parts[2].isdecimal() else None

    def __str__(self) -> str:
        return f"{self.host}-{self.boot}-{self.process}-{self.began}"

    @property
    def is_gone(self) -> bool | None:
        """Whether the process has ended; None where that cannot be seen from here."""
        if self.host != _host() or not (self.boot and self.began):
            return None
        return self.boot != _boot() or _began(self.process) != self.began


def hidden_beside(path: Path, ending: str = PARTIAL, suffix: str = "") -> Path:
    """Return a new hidden name beside a path that carries its owner; `suffix` comes last, as in ``.png``."""
    owner = Owner.of_this_process()
    return path.with_name(f".{_short(path.name)}.{owner}.{secrets.token_hex(4)}.{ending}{suffix}")


def settle(path: Path) -> None:
    """Clear away what commands that were killed had gathered for a path, and complete what they had begun to move."""
    with _one_at_a_time(path.parent):
        for left, ending in _left_for(path):
            with contextlib.suppress(FileNotFoundError):  # its owner may just have moved it
                if ending == MOVING:
                    _move_files(left, path)
                else:
                    _remove(left)


def put_in_place(staging: Path, folder: Path, *, keep_others: bool, merge: Callable[[], None] = lambda: None) -> None:
    """Put a complete folder in the place of another, in one step; signals wait until it is done.

    Parameters
    ----------
    staging
        A hidden folder beside `folder`; it is gone afterwards.
    folder
        Where its content goes; it need not be there.
    keep_others
        Whether files of the old folder stay that the new one has none of the same name of.
    merge
        Called before anything moves, while no other command can replace the folder.

    Raises
    ------
    OSError
        The system refuses; the old folder is as it was.
    """
    with signals_deferred(), _one_at_a_time(folder.parent):
        _put(staging, folder, keep_others, merge)
        _PUT.append(folder)


def _put(staging: Path, folder: Path, keep_others: bool, merge: Callable[[], None]) -> None:
    if not os.path.lexists(folder):
        staging.rename(folder)
        flush_folder(folder.parent)
        return
    if keep_others:
        _demand_no_conflict(staging, folder)
    merge()
    if _may_move(folder) and (not keep_others or _linked(folder, staging)):
        _made_alike(folder, staging)
        if _exchanged(staging, folder):
            flush_folder(folder.parent)
            _remove(staging)
            return
    moving = staging.with_name(staging.name.removesuffix(PARTIAL) + MOVING)
    staging.rename(moving)  # from here on the new content is what counts
    flush_folder(folder.parent)
    if not keep_others:
        _empty(folder)
    _move_files(moving, folder)


def put_in_place_so_far() -> tuple[Path, ...]:
    """Return the folders that this process has put in place: what stands if it is now broken off."""
    return tuple(_PUT)


@contextlib.contextmanager
def signals_deferred() -> Iterator[None]:
    """Let Ctrl-C and requests to end wait until the block is done; they then come as they would have."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []
    before: dict[int, Any] = {}
    try:
        for number in _DEFERRED:
            before[number] = signal.getsignal(number)
            if before[number] is not None:  # set by other than Python: left alone
                signal.signal(number, lambda caught, _: waiting.append(caught))
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
        for number in waiting[:1]:
            signal.raise_signal(number)


def flush_folder(folder: Path) -> None:
    """Have the names in a folder written to the disk."""
    # Windows cannot open a folder for this; its renames are journalled.
    with contextlib.suppress(PermissionError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _short(name: str) -> str:
    """Cut a long name: hidden ones carry more, and none may be longer than 255 bytes."""
    return (
        name if len(name.encode("utf-8", "surrogateescape")) <= 100 else hashlib.sha256(os.fsencode(name)).hexdigest()
    )


def _left_for(path: Path) -> Iterator[tuple[Path, str]]:
    """Give what was left behind for a path, with its ending."""
    form = rf"\.{re.escape(_short(path.name))}\.(?:([^.]+)\.)?[0-9a-f]+\.({PARTIAL}|{MOVING})(\.[^.]*)?"
    for left in sorted(path.parent.glob(f".{glob.escape(_short(path.name))}.*")):
        found = re.fullmatch(form, left.name, flags=re.DOTALL)
        if found is not None and _is_abandoned(left, found[1] or ""):
            yield left, found[2]


def _is_abandoned(left: Path, owner: str) -> bool:
    known = Owner.parsed(owner)
    gone = None if known is None else known.is_gone
    if gone is not None:
        return gone
    with contextlib.suppress(OSError):  # it may just have been moved
        return time.time() - left.lstat().st_mtime > ABANDONED_S
    return False


def _remove(left: Path) -> None:
    if left.is_dir() and not left.is_symlink():
        shutil.rmtree(left, ignore_errors=True)
    else:
        left.unlink(missing_ok=True)


def _demand_no_conflict(staging: Path, folder: Path) -> None:
    """Refuse to put a file in the place of somebody's folder, or a folder in the place of a file.

    Raises
    ------
    FileExistsError
        As described.
    """
    for new in staging.rglob("*"):
        there = folder / new.relative_to(staging)
        if os.path.lexists(there) and there.is_dir() is not new.is_dir():
            kind = "a folder" if there.is_dir() else "a file"
            raise FileExistsError(errno.EEXIST, f"{kind} of another's stands in the way", str(there))


def _linked(old: Path, new: Path) -> bool:
    """Give the new folder what the old one holds besides, as further names of the same files; say if all went."""
    try:
        device = old.stat().st_dev
        for entry in os.scandir(old):
            there = new / entry.name
            if entry.is_dir(follow_symlinks=False):
                if entry.stat(follow_symlinks=False).st_dev != device:
                    return False  # a mount: its content would be removed with the old folder
                if os.path.lexists(there) and (there.is_symlink() or not there.is_dir()):
                    continue
                made = not there.exists()
                there.mkdir(exist_ok=True)
                if not _linked(Path(entry.path), there):
                    return False
                if made:
                    shutil.copystat(entry.path, there)
            elif not os.path.lexists(there):
                os.link(entry.path, there, follow_symlinks=False)
    except (OSError, NotImplementedError):  # a file system without links
        return False
    return True


def _made_alike(old: Path, new: Path) -> None:
    """Give the new folder the owner and the rights of the old one."""
    there = old.stat()
    shutil.copystat(old, new)
    os.utime(new)
    with contextlib.suppress(OSError, AttributeError):  # only the superuser may give away, and not everywhere
        os.chown(new, there.st_uid, there.st_gid)
    flush_folder(new)


def _may_move(folder: Path) -> bool:
    """Whether a folder may change its identity: not a link or a mount, and not the place where this process works."""
    if folder.is_symlink() or os.path.ismount(folder):
        return False
    with contextlib.suppress(OSError):
        here = Path.cwd()
        return not any(os.path.samefile(folder, place) for place in (here, *here.parents))
    return False


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders by one call; False where there is no such call."""
    call = _exchange_call()
    if call is None:
        return False
    if call(os.fsencode(one), os.fsencode(other)) == 0:
        return True
    number = ctypes.get_errno()
    if number in _NOT_HERE:
        return False
    raise OSError(number, os.strerror(number), str(other))


@functools.cache
def _exchange_call() -> Callable[[bytes, bytes], int] | None:
    with contextlib.suppress(OSError, AttributeError, TypeError):
        libc = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "linux":
            return lambda one, other: libc.renameat2(_AT_FDCWD, one, _AT_FDCWD, other, _EXCHANGE)
        if sys.platform == "darwin":
            return lambda one, other: libc.renamex_np(one, other, _EXCHANGE)
    return None


def _empty(folder: Path) -> None:
    for entry in folder.iterdir():
        _remove(entry)


def _move_files(moving: Path, folder: Path) -> None:
    """Move what is complete into a folder, file by file; done again after a break, it does the rest."""
    folder.mkdir(exist_ok=True)
    for file in sorted(moving.rglob("*")):
        if file.is_dir() and not file.is_symlink():
            continue
        target = folder / file.relative_to(moving)
        target.parent.mkdir(parents=True, exist_ok=True)
        file.replace(target)
    flush_folder(folder)
    shutil.rmtree(moving, ignore_errors=True)


@contextlib.contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Let one command at a time replace what lies in a folder, where the system knows locks of folders."""
    try:
        import fcntl

        descriptor = os.open(folder, os.O_RDONLY)
    except (ImportError, OSError):
        yield
        return
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


@functools.cache
def _host() -> str:
    """Name the host and its namespace of processes: in another container the same number is another process."""
    with contextlib.suppress(OSError):
        return _hashed(socket.gethostname() + os.readlink("/proc/self/ns/pid"))
    return _hashed(socket.gethostname())


@functools.cache
def _boot() -> str:
    with contextlib.suppress(OSError):
        return _hashed(Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii"))
    return ""


def _began(process: int) -> str:
    """Give when a process began, in clock ticks since boot; empty where there is none, or nothing to tell it by."""
    with contextlib.suppress(OSError, ValueError):
        # The name in brackets may hold anything: what counts comes after the last one; 22nd field of proc(5).
        fields = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        return "" if fields[0] in "ZX" else fields[19]  # dead, only its parent has not asked yet
    return ""


def _hashed(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]
