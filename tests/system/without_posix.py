"""Run surfuse as on a machine without POSIX: `python without_posix.py COMMANDS`, a JSON list of command lines.

Modules that only POSIX has cannot be imported, what Windows lacks of `os`, `signal` and `socket` is gone, and folders
cannot be opened. What the libraries built for this machine cannot do without (`os.uname`) stays.
"""

import json
import os
import signal
import socket
import sys

MODULES = ("fcntl", "termios", "pty", "tty", "resource", "pwd", "grp", "syslog", "crypt", "spwd", "nis", "readline")
# ruff: noqa: SIM905
OF_OS = """
    chown chroot confstr ctermid fchdir fchmod fchown fork forkpty fpathconf get_blocking getegid geteuid getgid
    getgroups getloadavg getpgid getpgrp getpriority getresgid getresuid getsid getuid initgroups killpg lchown lockf
    major makedev minor mkfifo mknod nice openpty pathconf pipe2 posix_fadvise posix_fallocate pread preadv pwrite
    pwritev readv sched_getaffinity sched_yield sendfile set_blocking setegid seteuid setgid setgroups setpgid
    setpriority setregid setreuid setsid setuid statvfs fstatvfs sync sysconf tcgetpgrp tcsetpgrp ttyname wait
    wait3 wait4 writev memfd_create eventfd splice copy_file_range O_CLOEXEC O_NOFOLLOW O_DIRECTORY O_NONBLOCK O_SYNC
    O_DSYNC O_NOCTTY
""".split()
OF_SIGNAL = """
    SIGKILL SIGHUP SIGQUIT SIGUSR1 SIGUSR2 SIGALRM SIGPIPE SIGCHLD SIGTSTP SIGCONT SIGSTOP SIGWINCH alarm pause
    setitimer getitimer pthread_kill pthread_sigmask sigpending sigwait sigwaitinfo sigtimedwait siginterrupt
""".split()
OF_SOCKET = ("SO_REUSEPORT", "CMSG_LEN", "sendmsg_fds")


class Refuse:
    """Finds none of the POSIX modules."""

    def find_spec(self, name, path=None, target=None):
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named '{name}'", name=name)


def break_everything() -> None:
    sys.meta_path.insert(0, Refuse())
    for name in MODULES:
        sys.modules.pop(name, None)
    for module, names in ((os, OF_OS), (signal, OF_SIGNAL), (socket, OF_SOCKET)):
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    opened = os.open

    def refuse_folders(path, *arguments, **named):
        if not isinstance(path, int) and os.path.isdir(path):
            raise PermissionError(13, "Permission denied", os.fspath(path))
        return opened(path, *arguments, **named)

    os.open = refuse_folders


if __name__ == "__main__":
    break_everything()
    from surfuse import cli

    for words in json.loads(sys.argv[1]):
        sys.argv = ["surfuse", *words]
        try:
            cli.main()
        except SystemExit as ended:
            if ended.code:
                sys.exit(f"{words}: exit {ended.code}")
    sys.exit(0)
