#compdef lazyloc colmap-lazyloc colmap lazy_localizer lazy_epoch lazy_indexer lazy_merger
# Completes commands, options, and values that are one of a few, in bash and in zsh. All names come from the programs' help.
# In ~/.bashrc or ~/.zshrc: eval "$(lazyloc completion)". The Debian package installs this file for both shells.

# Prints what can take the place of the last word; prints nothing if that is the name of a file.
_lazyloc_names() {
  local program=$1 command=$2 word=${@: -1} previous=${@: -2:1} help=--help
  if [[ $program == *lazy_* ]]; then
    command=
  elif [[ $# -eq 2 && $program == *lazyloc && $program != *colmap-lazyloc ]]; then
    "$program" --help 2> /dev/null | sed -nE 's/^  ([a-z_]+) .*/\1/p'
    return
  elif [[ $# -eq 2 ]]; then
    "$program" help 2> /dev/null | sed '1,/^Available commands:/d'
    return
  fi
  if [[ $previous == --format || "$command $#" == "import 3" && $word != -* ]]; then
    "$program" "$command" --help 2> /dev/null | sed -nE 's/^  ([a-z0-9]+)  .*/\1/p' # the list of formats
    return
  fi
  [[ "$program $command" != *lazy_localizer* ]] || help=--help-all
  if [[ $word == -* || $previous != --* || $previous == *=* ]]; then
    "$program" ${command:+"$command"} "$help" 2>&1 | sed -nE 's/^ +(-h \[ )?(--[A-Za-z0-9_.-]+).*/\2/p'
  else
    "$program" ${command:+"$command"} "$help" 2>&1 | sed -nE "s/^ +$previous \[?\{([^}]+)\}.*/\1/p" | tr , '\n'
  fi
}

if [[ -n ${ZSH_VERSION:-} ]]; then
  _lazyloc() {
    compadd -- $(_lazyloc_names "${words[@]:0:$CURRENT}") || _files
  }
  if [[ ${funcstack[1]} == _lazyloc ]]; then # zsh loads this file as the function
    _lazyloc "$@"
  else
    command -v compdef > /dev/null || { autoload -Uz compinit && compinit; }
    compdef _lazyloc lazyloc colmap-lazyloc colmap lazy_localizer lazy_epoch lazy_indexer lazy_merger
  fi
else
  _lazyloc() {
    mapfile -t COMPREPLY < <(compgen -W "$(_lazyloc_names "${COMP_WORDS[@]:0:COMP_CWORD+1}")" -- "${COMP_WORDS[COMP_CWORD]}")
  }
  # bash offers the names of files if there is nothing else.
  complete -o default -F _lazyloc lazyloc colmap-lazyloc colmap lazy_localizer lazy_epoch lazy_indexer lazy_merger
fi
