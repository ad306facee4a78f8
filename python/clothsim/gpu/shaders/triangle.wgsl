// A triangle and a sphere around the origin (cpp/collision/triangle.hpp has the derivations; the names are the same).
struct Corners {
    a: vec3<wide>,
    b: vec3<wide>,
    c: vec3<wide>,
}

// The point of a triangle nearest to the origin.
struct Foot {
    at: vec3<wide>,
    weight: vec3<wide>,
}

struct TriangleTouch {
    hit: bool,
    time: wide,  // part of the way
    foot: Foot,
    normal: vec3<wide>,
}

fn wide_length(a: vec3<wide>) -> wide {
    return sqrt(wide_inner(a, a));
}

fn wide_cross(a: vec3<wide>, b: vec3<wide>) -> vec3<wide> {
    return vec3<wide>(
        wide_product(a.y, b.z) - wide_product(a.z, b.y),
        wide_product(a.z, b.x) - wide_product(a.x, b.z),
        wide_product(a.x, b.y) - wide_product(a.y, b.x));
}

// The direction of `a`; upwards if it has none.
fn direction(a: vec3<wide>, length: wide) -> vec3<wide> {
    if (length > zero) {
        return a / length;
    }
    return vec3<wide>(zero, one, zero);
}

// `best`, or the place of the side from `p` to `q` if that is nearer; `corners` are ones at these two.
fn nearer(best: Foot, p: vec3<wide>, q: vec3<wide>, at_p: vec3<wide>, at_q: vec3<wide>) -> Foot {
    let side = q - p;
    let length2 = wide_inner(side, side);
    var s = zero;
    if (length2 > zero) {
        s = min(max(-wide_inner(side, p) / length2, zero), one);
    }
    let place = p + wide_scaled(s, side);
    if (wide_inner(place, place) >= wide_inner(best.at, best.at)) {
        return best;
    }
    return Foot(place, wide_scaled(one - s, at_p) + wide_scaled(s, at_q));
}

fn nearest_to_origin(c: Corners) -> Foot {
    let first = vec3<wide>(one, zero, zero);
    let second = vec3<wide>(zero, one, zero);
    let third = vec3<wide>(zero, zero, one);
    var best = Foot(c.a, first);
    best = nearer(best, c.a, c.b, first, second);
    best = nearer(best, c.b, c.c, second, third);
    best = nearer(best, c.c, c.a, third, first);
    let ab = c.b - c.a;
    let ac = c.c - c.a;
    let normal = wide_cross(ab, ac);
    let area2 = wide_inner(normal, normal);
    if (!(area2 > zero)) {
        return best;
    }
    let b = -wide_inner(wide_cross(c.a, ac), normal) / area2;
    let d = -wide_inner(wide_cross(ab, c.a), normal) / area2;
    if (b < zero || d < zero || b + d > one) {
        return best;
    }
    let place = (c.a + wide_scaled(b, ab)) + wide_scaled(d, ac);
    if (wide_inner(place, place) < wide_inner(best.at, best.at)) {
        best = Foot(place, vec3<wide>((one - b) - d, b, d));
    }
    return best;
}

// Radius of the smallest circle around a triangle: half the longest side, or the circumradius if it is acute.
fn smallest_circle(c: Corners) -> wide {
    let x = wide_inner(c.b - c.c, c.b - c.c);
    let y = wide_inner(c.c - c.a, c.c - c.a);
    let z = wide_inner(c.a - c.b, c.a - c.b);
    let longest = max(x, max(y, z));
    let shortest = min(x, min(y, z));
    let middle = max(min(x, y), min(max(x, y), z));
    if (shortest + middle <= longest) {
        return sqrt(longest) / wide(2.0);
    }
    let twice_area = wide_length(wide_cross(c.b - c.a, c.c - c.a));
    return sqrt(wide_product(wide_product(shortest, middle), longest)) / (wide(2.0) * twice_area);
}

// How far along its way a corner comes to the plane, `2` if it does not.
fn way_to(normal: vec3<wide>, now: vec3<wide>, way: vec3<wide>, reach: wide) -> wide {
    let rate = wide_inner(normal, way);
    if (rate < zero) {
        return (wide_inner(normal, now) - reach) / -rate;
    }
    return wide(2.0);
}

// The first time at which the triangle comes as near as `reach`, to within `tolerance` above it.
fn triangle_touch(p0: Corners, p1: Corners, reach: wide, tolerance: wide) -> TriangleTouch {
    var t = TriangleTouch(false, zero, Foot(vec3<wide>(), vec3<wide>()), vec3<wide>());
    let way = Corners(p1.a - p0.a, p1.b - p0.b, p1.c - p0.c);
    for (var k = 0; k < 200; k++) {
        let now = Corners(
            p0.a + wide_scaled(t.time, way.a), p0.b + wide_scaled(t.time, way.b),
            p0.c + wide_scaled(t.time, way.c));
        t.foot = nearest_to_origin(now);
        let distance = wide_length(t.foot.at);
        t.normal = direction(t.foot.at, distance);
        t.hit = distance <= reach + tolerance;
        if (t.hit) {
            return t;
        }
        var advance = way_to(t.normal, now.a, way.a, reach);
        advance = min(advance, way_to(t.normal, now.b, way.b, reach));
        advance = min(advance, way_to(t.normal, now.c, way.c, reach));
        advance = min(advance, wide(2.0));
        if (t.time + advance >= one) {
            if (advance < wide(2.0) && t.time < one) {
                t.time = one;  // the end itself is looked at once
                continue;
            }
            return t;
        }
        t.time += advance;
    }
    t.hit = true;
    return t;
}
