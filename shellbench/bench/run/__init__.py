"""Making runs: the plan, the processes, this machine or a cluster, and what is shown meanwhile.

It may import the store and what is below it. It judges nothing.
"""
