"""Where the telescope looks next, with one satellite followed or with several. Pure."""
