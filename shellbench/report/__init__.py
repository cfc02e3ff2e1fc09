"""Tables, plots and the page. This package knows records, the rows that compare them, and known values only."""
