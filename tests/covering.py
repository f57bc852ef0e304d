"""Covering arrays: few cases that hold every valid combination of the values of a few axes."""

import functools
import itertools
import random


def subsets(case, strength):
    return {frozenset(part) for part in itertools.combinations(case.items(), strength)}


class Table:
    """Cases, one value per axis; `impossible`: combinations (values by axis) that no case has."""

    def __init__(self, axes, impossible):
        self.axes, self.impossible = axes, impossible

    def possible(self, case):
        """No combination that is impossible; `case` may lack axes."""
        return not any(
            all(case.get(axis) in values for axis, values in rule.items())
            for rule in self.impossible
        )

    def completed(self, case):
        """Whether values for the axes that `case` lacks exist."""
        if not self.possible(case):
            return False
        axis = next((a for a in self.axes if a not in case), None)
        return axis is None or any(
            self.completed(case | {axis: value}) for value in self.axes[axis]
        )

    def combinations(self, strength):
        """All that are part of some case: the keys, in a fixed order."""
        return dict.fromkeys(
            frozenset(zip(axes, values, strict=True))
            for axes in itertools.combinations(self.axes, strength)
            for values in itertools.product(*(self.axes[axis] for axis in axes))
            if self.completed(dict(zip(axes, values, strict=True)))
        )

    @functools.cache  # noqa: B019
    def covering(self, strength, candidates=30):
        """Cases that hold every valid combination of `strength` values: greedy, deterministic.

        Each case starts from a combination not yet held; the other axes, in some random order, take
        the value that adds most; the best of several candidates stays (AETG; Cohen et al. 1997).
        """
        missing = self.combinations(strength)
        chance, cases = random.Random(0), []

        def candidate():
            case = dict(next(iter(missing)))
            for axis in chance.sample(list(self.axes), len(self.axes)):
                if axis not in case:
                    values = [v for v in self.axes[axis] if self.completed(case | {axis: v})]
                    chance.shuffle(values)
                    case[axis] = max(values, key=lambda v: gain(case, axis, v))
            return case

        def gain(case, axis, value):
            return sum(
                frozenset((*part, (axis, value))) in missing
                for part in itertools.combinations(case.items(), strength - 1)
            )

        while missing:
            best = max(
                (candidate() for _ in range(candidates)),
                key=lambda case: len(subsets(case, strength) & missing.keys()),
            )
            for part in subsets(best, strength):
                missing.pop(part, None)
            cases.append({axis: best[axis] for axis in self.axes})
        return tuple(cases)
