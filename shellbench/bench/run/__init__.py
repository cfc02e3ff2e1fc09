"""Runs: the plan, the processes, this machine or a cluster, and the progress display.

This package may import the store and the packages below it. It judges nothing.
"""
