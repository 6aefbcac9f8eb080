"""Compiled loops over the arm's primitives: placing them, their lowest points, their overlaps."""

from __future__ import annotations

from math import sqrt

import numpy as np

from packenv.kernels import compiled


@compiled
def place(frames, links, local, ends):  # type: ignore[no-untyped-def]
    """Axis ends of every primitive in the base frame.

    Args:
        frames: (n, 7, 4, 4) link frames.
        links: (p,) link of each primitive.
        local: (p, 2, 3) axis ends in the link's frame, m.
        ends: (n, p, 2, 3), overwritten, m.
    """
    for k in range(frames.shape[0]):
        for p in range(links.size):
            frame = frames[k, links[p]]
            for e in range(2):
                for i in range(3):
                    ends[k, p, e, i] = (
                        frame[i, 0] * local[p, e, 0]
                        + frame[i, 1] * local[p, e, 1]
                        + frame[i, 2] * local[p, e, 2]
                        + frame[i, 3]
                    )


@compiled
def arm_lowest(frames, links, local, radii, rounded, gripper, low):  # type: ignore[no-untyped-def]
    """Lowest z of the primitives of links 2 to 6, the gripper left out.

    Args:
        frames: (n, 7, 4, 4) link frames.
        links: (p,) link of each primitive.
        local: (p, 2, 3) axis ends in the link's frame, m.
        radii: (p,) m.
        rounded: (p,) bool, round ends.
        gripper: index of the gripper.
        low: (n,), overwritten, m.
    """
    for k in range(frames.shape[0]):
        low[k] = np.inf
        for p in range(links.size):
            if links[p] < 2 or p == gripper:
                continue
            frame = frames[k, links[p]]
            a, b, length = frame[2, 3], frame[2, 3], 0.0
            for j in range(3):
                a += frame[2, j] * local[p, 0, j]
                b += frame[2, j] * local[p, 1, j]
                length += (local[p, 1, j] - local[p, 0, j]) ** 2
            share = 1.0
            if not rounded[p]:
                # A flat end reaches down by its radius times the sine of the axis's angle to the vertical.
                share = sqrt(max(0.0, 1.0 - (b - a) * (b - a) / length))
            low[k] = min(low[k], min(a, b) - radii[p] * share)


@compiled
def any_overlap(ends, radii, pairs, hit):  # type: ignore[no-untyped-def]
    """Whether any of the listed pairs of capsules overlaps.

    Args:
        ends: (n, p, 2, 3) m.
        radii: (p,) m.
        pairs: (c, 2) indices.
        hit: (n,) bool, overwritten.
    """
    if not ends.shape[0]:
        return
    half = np.zeros(radii.size)
    for p in range(radii.size):
        for i in range(3):
            half[p] += (ends[0, p, 1, i] - ends[0, p, 0, i]) ** 2 / 4.0
        half[p] = sqrt(half[p])
    for k in range(ends.shape[0]):
        hit[k] = False
        for c in range(pairs.shape[0]):
            a, b = pairs[c, 0], pairs[c, 1]
            reach = radii[a] + radii[b]
            apart = 0.0
            for i in range(3):
                middle = ends[k, a, 0, i] + ends[k, a, 1, i] - ends[k, b, 0, i] - ends[k, b, 1, i]
                apart += middle * middle / 4.0
            # Balls around the capsules that do not meet: no need to look closer.
            if apart > (reach + half[a] + half[b]) ** 2:
                continue
            if segment_distance2(ends[k, a], ends[k, b]) < reach * reach:
                hit[k] = True
                break


@compiled
def segment_distance2(first, second):  # type: ignore[no-untyped-def]
    """Squared distance of two segments, (2, 3) each, of length above 0 (Ericson 2005, Sec. 5.1.9)."""
    aa = bb = ab = ar = br = 0.0
    for i in range(3):
        u = first[1, i] - first[0, i]
        v = second[1, i] - second[0, i]
        r = first[0, i] - second[0, i]
        aa += u * u
        bb += v * v
        ab += u * v
        ar += u * r
        br += v * r
    across = aa * bb - ab * ab
    s = 0.0
    if across > 1e-12 * aa * bb:
        s = min(1.0, max(0.0, (ab * br - ar * bb) / across))
    t = (ab * s + br) / bb
    if t < 0.0:
        t = 0.0
        s = min(1.0, max(0.0, -ar / aa))
    elif t > 1.0:
        t = 1.0
        s = min(1.0, max(0.0, (ab - ar) / aa))
    total = 0.0
    for i in range(3):
        gap = first[0, i] - second[0, i] + s * (first[1, i] - first[0, i]) - t * (second[1, i] - second[0, i])
        total += gap * gap
    return total
