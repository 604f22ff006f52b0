/* Opened from the disk, a page may not read another one: search shows titles alone, without asking for each in vain. */
if (location.protocol === "file:") DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false;
