"""The commands as functions: `run`, `run_map`, `make_report`.

`run_command`, `map_command` and `report_command` are what the command line (cli.py) calls: their results carry an exit status.
The functions at the door return a `Run`, and raise what an exit status says.
"""
