"""Everything that leaves the program: fields, histories, checkpoints, summary, figures,
progress.
"""
