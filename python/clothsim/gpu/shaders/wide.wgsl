// Responses in float64, for adapters that have it: the two parts of single precision join, as in the core.
fn widened(value: vec3<real>, low: vec3<real>) -> vec3<wide> {
    return select(vec3<wide>(value), vec3<wide>(value) + vec3<wide>(low), compensated);
}

fn position_from(body: Body, contact: Contact) -> vec3<wide> {
    return widened(body.position, body.position_low) - contact.place;
}

fn way(body: Body, before: Body, contact: Contact, start: Contact) -> vec3<wide> {
    return position_from(body, contact) - position_from(before, start);
}

fn velocity_of(body: Body) -> vec3<wide> { return widened(body.velocity, body.velocity_low); }

fn moved_body(body: Body, contact: Contact, responded: Response) -> Body {
    var position = widened(body.position, body.position_low);
    if (responded.moved) { position = contact.place + responded.d; }
    let x = vec3<real>(position);
    let v = vec3<real>(responded.velocity);
    return Body(x, vec3<real>(position - vec3<wide>(x)), v, vec3<real>(responded.velocity - vec3<wide>(v)));
}
