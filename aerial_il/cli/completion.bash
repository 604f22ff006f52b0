# COMP_WORDBREAKS splits at "=": the word under the cursor is taken from the line itself, and only what
# stands behind the last "=" is handed back.
_aerial_il() {
    local line="${COMP_LINE:0:COMP_POINT}" word
    word="${line##* }"
    local IFS=$'\n'
    COMPREPLY=($(aerial-il _complete ${line// /$'\n'} ${line:+$([[ "$line" == *" " ]] && echo "''")} 2>/dev/null))
    if [[ "$word" == *=* ]]; then
        if [ ${#COMPREPLY[@]} -eq 0 ]; then COMPREPLY=($(compgen -f -- "${word##*=}")); compopt -o filenames 2>/dev/null
        else COMPREPLY=("${COMPREPLY[@]#"${word%%=*}="}"); fi
    fi
    [[ ${#COMPREPLY[@]} -eq 1 && "${COMPREPLY[0]}" == *= ]] && compopt -o nospace 2>/dev/null
    [[ ${#COMPREPLY[@]} -gt 1 ]] && compopt -o nospace 2>/dev/null
    return 0
}
complete -F _aerial_il aerial-il
