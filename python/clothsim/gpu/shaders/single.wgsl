// Single precision: float32 whose state keeps what rounding takes in a second float32, responses in float64,
// as in the core.
alias real = f32;
alias wide = f64;
const compensated = true;

// The same value, through integers and a zero that no compiler knows, so that none carries an identity of
// real numbers through it: (a + b) - a must not become b, and a product not part of a fused multiply-add.
fn keep(a: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(a) | constants.zero);
}

fn keep_wide(a: f64) -> f64 {
    return bitcast<f64>(bitcast<u64>(a) | u64(constants.zero));
}

fn is_finite(a: f32) -> bool {
    return (bitcast<u32>(a) & 0x7f800000u) != 0x7f800000u;
}

fn widened(value: vec3<f32>, low: vec3<f32>) -> vec3<f64> {
    return vec3<f64>(value) + vec3<f64>(low);
}

fn position_from(body: Body, contact: Contact) -> vec3<f64> {
    return widened(body.position, body.position_low) - contact.center;
}

fn velocity_of(body: Body) -> vec3<f64> {
    return widened(body.velocity, body.velocity_low);
}

fn narrowed(position: vec3<f64>, velocity: vec3<f64>) -> Body {
    let x = vec3<f32>(position);
    let v = vec3<f32>(velocity);
    return Body(x, vec3<f32>(position - vec3<f64>(x)), v, vec3<f32>(velocity - vec3<f64>(v)));
}

fn answered(body: Body, contact: Contact, answer: Answer) -> Body {
    var position = widened(body.position, body.position_low);
    if (answer.moved) {
        position = contact.center + answer.on_surface;
    }
    return narrowed(position, answer.velocity);
}
