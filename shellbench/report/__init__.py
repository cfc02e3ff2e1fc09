"""Tables, plots and the page. This package knows records, the rows that compare them, and known values only.

`data.solutions` turns rows into the numbers of a table, `data.columns` names the columns, `data.table` writes them.
`sections.tables` is the table that `shellbench table` prints. `page` puts all sections together.
"""
