// Responses in float32, for adapters without float64. A point is taken relative to the obstacle
// first, both with their low parts. So a response errs by units in the last place of the radius,
// not of the coordinates.
fn spot_of(body: Body) -> Spot { return Spot(body.position, body.position_low); }
fn spot_from(a: Spot, b: Spot) -> vec3<f32> {
    return keep_all(a.whole - b.whole) + (a.low - b.low);
}

// a + d with its rounding error (Knuth's two-sum).
fn beyond(a: Spot, d: vec3<f32>) -> Spot {
    let sum = keep_all(a.whole + d);
    let part = keep_all(sum - a.whole);
    return Spot(sum, (a.whole - keep_all(sum - part)) + (d - part) + a.low);
}

fn velocity_of(body: Body) -> vec3<f32> { return body.velocity; }

fn body_at(body: Body, at: Spot, velocity: vec3<f32>) -> Body {
    let low = select(vec3<f32>(), body.velocity_low, all(velocity == body.velocity));
    return Body(at.whole, at.low, velocity, low);
}
