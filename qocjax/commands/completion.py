"""Completion for shells: the words of every command, written into a script, so that a shell asks nobody."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from qocjax._conf import conf_dir, hydra_base
from qocjax.commands.help import choices_of, offered

__all__ = ["SHELLS", "completion", "words_of"]

SHELLS = ("bash", "zsh")
_FLAGS = ("--help", "--multirun", "--cfg", "--info", "--version")

# Bash breaks words at `=` and `@`, and wants only what follows the last of them; zsh wants whole words.
_SCRIPT = """\
_qocjax() {
  [[ -n ${ZSH_VERSION-} ]] && emulate -L sh
  local line="${COMP_LINE:0:$COMP_POINT}" words="" found="" each word before command
  word="${line##* }"
  command="${line#* }"; command="${command%% *}"
  if [[ ${line% *} != *" "* ]]; then words="@COMMANDS@ --help --version --completion"
  else
    case "$command" in
@CASES@
    esac
  fi
  before=""
  [[ $word == *=* ]] && before="${word%%=*}="
  for each in $words; do
    case "$each" in
      "$before"?*) if [[ -n $before ]]; then found="$found $each"; else
        case "$each" in *=*) found="$found ${each%%=*}=" ;; *) found="$found $each" ;; esac; fi ;;
    esac
  done
  if [[ -n $found || -z $before ]]; then COMPREPLY=($(compgen -W "$(printf '%s\\n' $found | sort -u)" -- "$word"))
  else COMPREPLY=($(compgen -f -P "$before" -- "${word#*=}")); fi
  [[ -n ${ZSH_VERSION-} ]] && return
  [[ ${COMPREPLY[0]-} == *= ]] && compopt -o nospace 2>/dev/null
  before="${word%"${word##*[=@]}"}"
  COMPREPLY=("${COMPREPLY[@]#"$before"}")
}
complete -F _qocjax qocjax
"""


def completion(shell: str, commands: Sequence[str]) -> str:
    """The script that a shell sources.

    Args:
        shell: One of `SHELLS`; zsh takes the script of bash through its own `bashcompinit`.
        commands: Names of the commands.
    """
    cases = [f"    {name}) words={shlex.quote(' '.join(words_of(name)))} ;;" for name in commands]
    script = _SCRIPT.replace("@COMMANDS@", " ".join(commands)).replace("@CASES@", "\n".join(cases))
    return script if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{script}"


def words_of(command: str) -> list[str]:
    """What may follow a command: `option=`, each `group=choice`, and flags.

    Args:
        command: Its name.
    """
    with initialize_config_dir(str(conf_dir()), **hydra_base()):
        cfg = compose(command, return_hydra_config=True)
        words = ["hydra.run.dir="]
        for choice in choices_of(cfg):
            words += [f"{choice}={name}" for name in offered(cfg, choice.split("@")[0])]
    options = OmegaConf.to_container(cfg, resolve=False)
    assert isinstance(options, dict)
    return [*words, *(f"{name}=" for name in _leaves({k: v for k, v in options.items() if k != "hydra"})), *_FLAGS]


def _leaves(options: dict, at: str = "") -> list[str]:
    found = []
    for key, value in options.items():
        found += _leaves(value, f"{at}{key}.") if isinstance(value, dict) and value else [f"{at}{key}"]
    return found
