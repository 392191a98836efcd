"""The paper's section 5 on a simulated axis: every table and figure, our number beside theirs.

One module a subject; each has `measure(stand)`, which makes the experiment, and `chapter(result)`, which draws it.
"""
