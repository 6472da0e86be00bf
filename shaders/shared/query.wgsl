// Traversal of the device's own tree by a hardware ray query. The tree is over boxes, one around each pair of
// triangles. A reported box is tested as a leaf of the other trees is. When a hit is certain, the query gets a shorter
// interval.
//
// Vulkan promises a candidate for every box that holds a point of the ray within its interval, and allows more ("Ray
// Intersection Candidate Determination"). It gives no bound on the rounding of the test, so the boxes are pushed out by
// a margin (MARGIN in `trace/gpu/flatten/boxes.rs`, which derives it). Rays that begin too far away for that margin are
// UNCERTAIN: see `prepare`.

fn traverse(ray: PreparedRay, found: ptr<function, Found>) {
    var nowhere: TreeInstance;
    var query: ray_query;
    rayQueryInitialize(
        &query,
        boxes,
        RayDesc(RAY_FLAG_NONE, 0xffu, ray.t_min, ray.t_max, ray.origin, ray.slanted),
    );
    var is_told = false;
    loop {
        if !rayQueryProceed(&query) {
            return;
        }
        let index = rayQueryGetCandidateIntersection(&query).primitive_index;
        let reference = LEAF | index | select(0u, MASKED, index >= FIRST_MASKED);
        if through_leaf(ray, reference, nowhere, found) {
            return;
        }
        // Only once: at a second time naga 30.0.1 compares with the candidate's distance instead of the committed one,
        // and a box has no candidate distance.
        let limit = limit_of(found);
        if !is_told && limit < ray.t_max {
            rayQueryGenerateIntersection(&query, limit);
            is_told = true;
        }
    }
}
