// Responses in float32, for adapters without float64. A point is taken relative to the sphere first, both with their low
// parts. So a response errs by units in the last place of the radius, not of the coordinates.
fn spot_of(body: Body) -> Spot { return Spot(body.position, body.position_low); }
fn spot_from(a: Spot, b: Spot) -> vec3<f32> { return keep_all(a.whole - b.whole) + (a.low - b.low); }

// a + d with its rounding error (Knuth's two-sum).
fn beyond(a: Spot, d: vec3<f32>) -> Spot {
    let sum = keep_all(a.whole + d);
    let part = keep_all(sum - a.whole);
    return Spot(sum, (a.whole - keep_all(sum - part)) + (d - part) + a.low);
}

// As in wide.wgsl, but as the difference of two short ways.
fn way(end: Spot, x: Spot, place: Spot, path: Spot) -> vec3<f32> { return spot_from(end, x) - spot_from(place, path); }

fn velocity_of(body: Body) -> vec3<f32> { return body.velocity; }

fn body_at(body: Body, at: Spot, velocity: vec3<f32>) -> Body {
    if (all(velocity == body.velocity)) { return Body(at.whole, at.low, body.velocity, body.velocity_low); }
    return Body(at.whole, at.low, velocity, vec3<f32>());
}
