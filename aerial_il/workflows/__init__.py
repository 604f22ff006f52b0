"""What can be done, each a file: typed settings and one function, which Python and the command line call alike."""
