"""What can be done: one file each, typed settings and a function, which Python and the command line call alike."""
