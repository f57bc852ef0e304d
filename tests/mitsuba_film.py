"""An emitter for Mitsuba 3 that shines from a camera's film along its rays: light run backwards."""

import drjit as dr
import mitsuba as mi


def film_emitter():
    """The plugin "film", of the variant that is set."""

    class Film(mi.Emitter):
        def __init__(self, props):
            mi.Emitter.__init__(self, props)
            self.m_flags = +mi.EmitterFlags.DeltaPosition
            Film.last = self

        def aim(self, eye, axes, half, perspective):
            self.eye, (self.right, self.up, self.forward) = (
                mi.Point3f(*eye),
                (mi.Vector3f(a.tolist()) for a in axes),
            )
            self.half, self.perspective = half, perspective

        def open(self, low, high):
            """Only the part of the film from `low` to `high` [half widths] shines."""
            self.low, self.high = (mi.Point2f(*p) for p in (low, high))
            dr.make_opaque(self.low, self.high)  # one kernel for all blocks

        def sample_direction(self, it, sample, active=True):
            away = it.p - self.eye
            depth = dr.dot(away, self.forward)
            scale = self.half * (depth if self.perspective else 1.0)
            film = mi.Point2f(dr.dot(away, self.right), dr.dot(away, self.up)) / scale
            active &= dr.all((film >= self.low) & (film < self.high)) & (depth > 0)
            distance = dr.norm(away) if self.perspective else depth
            area = (self.high.x - self.low.x) * (self.high.y - self.low.y) * self.half**2
            value = dr.rcp(area)
            if self.perspective:
                value *= distance / depth**3  # 1 / (cos^3 distance^2)
            ds = dr.zeros(mi.DirectionSample3f)
            ds.d = -away / distance if self.perspective else -self.forward
            ds.p = it.p + ds.d * distance
            ds.n, ds.dist, ds.pdf, ds.delta = -ds.d, distance, 1.0, True
            ds.emitter = mi.EmitterPtr(self)
            return ds, mi.Color3f(value) & active

        def eval(self, si, active=True):
            return mi.Color3f(0)

        def eval_direction(self, it, ds, active=True):
            return mi.Color3f(0)

        def pdf_direction(self, it, ds, active=True):
            return mi.Float(0)

        def set_scene(self, scene):
            pass

        def bbox(self):
            return mi.ScalarBoundingBox3f()

        def to_string(self):
            return "Film[]"

    mi.register_emitter("film", Film)
    return Film
