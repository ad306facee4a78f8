// Responses in float32, for adapters without float64. A point is taken relative to the obstacle
// first, both with their low parts. So a response errs by units in the last place of the radius,
// not of the coordinates.
fn spot_of(point: PointState) -> Spot { return Spot(point.position, point.position_low); }
fn spot_difference(a: Spot, b: Spot) -> vec3<f32> {
    return keep_all(a.whole - b.whole) + (a.low - b.low);
}

// a + d with its rounding error (Knuth's two-sum).
fn spot_sum(a: Spot, d: vec3<f32>) -> Spot {
    let sum = keep_all(a.whole + d);
    let part = keep_all(sum - a.whole);
    return Spot(sum, (a.whole - keep_all(sum - part)) + (d - part) + a.low);
}

fn velocity_of(point: PointState) -> vec3<f32> { return point.velocity; }

fn state_at_spot(point: PointState, at: Spot, velocity: vec3<f32>) -> PointState {
    let low = select(vec3<f32>(), point.velocity_low, all(velocity == point.velocity));
    return PointState(at.whole, at.low, velocity, low);
}
