"""The report put together: the order of sections, page, Markdown, paper, board, and what `compare` prints.

It may import all other rooms of the report; none imports it.
"""
