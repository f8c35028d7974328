"""Studies: many short runs and the tables that they make (coupling, stability, work against error);
on one rank.
"""
