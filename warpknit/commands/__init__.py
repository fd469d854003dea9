"""The commands as functions: `run`, `run_map`, `make_report`.

`run_command`, `map_command` and `report_command` serve the command line (cli.py): their results carry an exit status. The
functions of the public API return a `Run`, and raise errors in place of exit statuses.
"""
