"""What the command lines share: options composed, what computes imported after them, errors in one line."""

from __future__ import annotations

import gc
import inspect
import os
import re
import shlex
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from qocjax._beside import process_beside
from qocjax._conf import conf_dir, hydra_base
from qocjax.commands.misspelt import check_options, unknown_option
from qocjax.commands.output import steady_output, written_too
from qocjax.commands.resolvers import register_resolvers
from qocjax.commands.stopping import as_program, goes_on, stoppable

if TYPE_CHECKING:  # Hydra is imported once a program can be stopped in one line
    from hydra._internal.hydra import Hydra
    from omegaconf import DictConfig

    from qocjax.config.part import Part

__all__ = ["Command", "given_options", "no_collection", "output_dir", "unforeseen"]

_LONGEST = 2000  # letters of an error


@dataclass(frozen=True)
class Command:
    """A Hydra command line with the primary configuration `conf/<name>.yaml`.

    What it does is `main(cfg)` in `qocjax.commands.<name>`, which is imported when the options are composed and keep to
    their schema: help and a wrong option need nothing that simulates or draws.

    Attributes:
        name: Of the configuration.
        schema: Module and class of its schema, such as `study.StudyConfig` in `qocjax.config`.
        short: Options that stand for two others: `path=FILE` for one that is given as it is, and one that takes the
            value, such as `{"path": ("network=trace", "network.path")}`.
        nav2: Whether it takes `nav2=FILE`, a file of Nav2's parameters that stands for options.
        draws: What a process beside this one imports, to draw figures; `main` takes it as its second argument, or None.
        rewrite: Makes options of other arguments.
    """

    name: str
    schema: str
    short: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    nav2: bool = False
    draws: str = ""
    rewrite: Callable[[Sequence[str]], list[str]] = list

    def model(self) -> type[Part]:
        """The class of the schema."""
        module, _, name = self.schema.partition(".")
        return getattr(import_module(f"qocjax.config.{module}"), name)

    def as_program(self) -> None:
        """Runs as all that this process does: see `stopping`."""
        as_program(self)

    def __call__(self) -> None:
        """Runs what the program's arguments ask; an error ends it with one line."""
        with steady_output():
            self._run()

    def _run(self) -> None:
        from hydra.errors import HydraException
        from omegaconf.errors import OmegaConfBaseException

        from qocjax.commands.help import register_help
        from qocjax.commands.quoting import quoted_options

        register_resolvers()
        register_help()
        warnings.formatwarning = lambda text, *rest, **more: f"note: {text}\n"  # what is told is for users
        arguments = _of_target(_expanded(self.rewrite(sys.argv[1:]), self.short))
        os.environ["HYDRA_FULL_ERROR"] = "1"  # what Hydra finds comes out as an error, not as its many lines
        try:
            sys.argv[1:] = quoted_options(_of_nav2(arguments) if self.nav2 else arguments)
            _check_help(sys.argv[1:])
            check_options(sys.argv[1:], self.name)
            self._composed()
        except (HydraException, OmegaConfBaseException, OSError, ValueError) as error:
            if os.environ.get("QOCJAX_TRACEBACK"):
                raise
            cause = error.__cause__  # the log that cannot be written comes out as a ValueError of `logging`
            _fail(cause if isinstance(cause, OSError) else error, self.name)

    def _composed(self) -> None:
        """Composes the options, and does what they ask."""
        import hydra

        def task(cfg: DictConfig) -> None:
            with _one_line():
                self._work(cfg)

        task.__module__ = f"qocjax.commands.{self.name}"  # Hydra names the job by it
        _compose_once()
        hydra.main(config_path=str(conf_dir()), config_name=self.name, **hydra_base())(task)()

    def _work(self, cfg: DictConfig) -> None:
        if cfg.get("nav2") is not None and "nav2" not in given_options():
            raise ValueError(f"nav2: got {cfg.nav2} from a configuration file, expected it on the command line")
        folder = output_dir()
        way_on = partial(_way_on, folder)
        goes_on(way_on)
        drawn = bool(self.draws) and cfg.get("figures") is True
        with process_beside(self.draws) if drawn else nullcontext() as drawing:  # ready by the time of the first figure
            cache = _set_up_jax()
            with no_collection():
                from qocjax._kept import kept_in
                from qocjax.commands.claimed import claimed
                from qocjax.config.part import load  # with JAX, which composing does without

                for text in load(self.model(), cfg).remarks():
                    print(f"note: {text}", file=sys.stderr)
                work = import_module(f"qocjax.commands.{self.name}")
            page = written_too(folder / f"{self.name}.txt")
            with kept_in(cache and cache / "traced"), claimed(folder, self.name), stoppable(way_on), page:
                work.main(cfg, *([drawing] if self.draws else []))


@contextmanager
def _one_line() -> Iterator[None]:
    """Ends the program with one line for whatever goes wrong."""
    try:
        yield
    except Exception as error:
        if os.environ.get("QOCJAX_TRACEBACK"):
            raise
        from qocjax.commands.foreseen import is_foreseen, memory_text

        _fail(error if is_foreseen(error) else ValueError(memory_text(error) or unforeseen(error)))
    except KeyboardInterrupt as stop:
        print(": ".join(["stopped", *map(str, stop.args)]), file=sys.stderr)
        sys.exit(130)


def _compose_once() -> None:
    """Spares Hydra the composition that it makes to learn of `hydra.mode` alone, where nothing can have set it.

    A Hydra that asks for it otherwise, as 1.4 does, is left alone.
    """
    from hydra._internal.hydra import Hydra

    asked = Hydra.get_mode
    if list(inspect.signature(asked).parameters) != ["self", "config_name", "overrides"]:
        return

    def mode(self: Hydra, config_name: str | None, overrides: list[str]) -> Any:
        own = any(each.startswith(("-c", "--config")) for each in sys.argv[1:])  # files that are not of the package
        return asked(self, config_name, overrides) if own or any("hydra.mode" in each for each in overrides) else None

    if asked.__module__ == Hydra.__module__:  # not yet
        Hydra.get_mode = mode  # type: ignore[method-assign]


@contextmanager
def no_collection() -> Iterator[None]:
    """Looks for no garbage while modules are imported, nor later in what they made: all of it stays."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def _check_help(arguments: Sequence[str]) -> None:
    """Flags are Hydra's; the text of `--help` is a part of the configuration, and no choice."""
    from hydra._internal.utils import get_args_parser

    parser = get_args_parser()

    def refuse(message: str) -> NoReturn:
        raise ValueError(f"command line: {message}; options come before flags, see --help")

    parser.error = refuse  # type: ignore[method-assign]  # which would tell of each flag in many lines
    parser.parse_args(list(arguments))
    for argument in arguments:
        if re.match(r"[+~]*help(@[^=]*)?(=|$)", argument):
            raise ValueError(f"help: got {argument}, expected --help")


def _expanded(arguments: list[str], short: Mapping[str, tuple[str, str]]) -> list[str]:
    found = []
    for argument in arguments:
        name, mark, value = argument.partition("=")
        found += [short[name][0], f"{short[name][1]}={value}"] if mark and name in short else [argument]
    return found


def _of_target(arguments: list[str]) -> list[str]:
    """With `controller._target_=my.module.Law` in them: a choice of its own, which may be given any argument."""
    if not any(re.match(r"[+]*controller\._target_=", each) for each in arguments):
        return arguments
    given = [re.sub(r"^[+]*(?=controller\.\w)", "++", each) for each in arguments]
    return given if any(each.startswith("controller=") for each in given) else ["controller=custom", *given]


def _of_nav2(arguments: list[str]) -> list[str]:
    """The arguments with what `nav2=FILE` stands for in front; what there is to tell goes to standard error."""
    if not any(each.startswith("nav2=") for each in arguments):
        return arguments
    from qocjax.nav2.command_line import with_nav2  # takes a while to import, and few commands need it

    found, notes = with_nav2(arguments)
    print("".join(f"note: {text}\n" for text in notes), end="", file=sys.stderr)
    return found


def _fail(error: Exception, command: str | None = None) -> NoReturn:
    """Ends the program with an error in one line, of a command's options where they were being composed."""
    text = str(error).partition("Config search path")[0].strip()  # Hydra lists folders there
    text = text.removeprefix("ValueError raised while resolving interpolation: ")
    if isinstance(error, OSError) and error.filename and error.strerror:
        text = f"{error.filename}: {error.strerror}"
    for lines, line in ((r":\s*\n\s*", ": "), (r"\.\s*\n\s*", ". "), (r"\s*\n\s*", ", ")):
        text = re.sub(lines, line, text)
    if command is not None:
        text = unknown_option(text, command)
    print(f"error: {text if len(text) <= _LONGEST else text[:_LONGEST] + ' ...'}", file=sys.stderr)
    sys.exit(2)


def unforeseen(error: Exception) -> str:
    """What no check foresaw, in a line: its kind, what it says, where it was raised, and how to see the rest."""
    at = traceback.extract_tb(error.__traceback__)[-1]
    said = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return f"{said} ({at.filename}, line {at.lineno}); QOCJAX_TRACEBACK=1 shows the traceback, to report it"


def _set_up_jax() -> Path | None:
    """Fast loops on CPUs, and compiled programs kept between runs in the user's cache folder, which is returned."""
    import jax

    from qocjax._xla import request_whole_loop

    request_whole_loop()
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        try:
            cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "qocjax" / "xla"
            jax.config.update("jax_compilation_cache_dir", str(cache))
        except RuntimeError:  # a user without a home has no cache
            pass
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    folder = jax.config.jax_compilation_cache_dir
    return Path(folder) if folder and "://" not in folder else None  # JAX takes buckets too


def _way_on(folder: Path) -> str | None:
    """How to go on with what a folder holds; None where it keeps nothing that can be gone on with."""
    # By its name in `store.study_folder`, which is not to be imported as a program ends.
    return f"resume={shlex.quote(str(folder))} goes on" if (folder / "study.json").is_file() else None


def output_dir() -> Path:
    """Folder of this run's results."""
    from hydra.core.hydra_config import HydraConfig

    return Path(HydraConfig.get().runtime.output_dir)


def given_options() -> list[str]:
    """Names of the options that the command line gives, without those of Hydra itself."""
    from hydra.core.hydra_config import HydraConfig

    return [re.split(r"[=@]", option.lstrip("+~"))[0] for option in HydraConfig.get().overrides.task]
