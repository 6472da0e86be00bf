//! The page in the browser: files that are part of the program.

use crate::http::state::State;
use axum::Router;
use axum::http::header;
use axum::response::IntoResponse;
use axum::routing::get;

/// The files: address, media type, content.
const FILES: [(&str, &str, &str); 11] = [
    ("/", "text/html; charset=utf-8", include_str!("index.html")),
    ("/style.css", "text/css; charset=utf-8", include_str!("style.css")),
    ("/icon.svg", "image/svg+xml", include_str!("icon.svg")),
    ("/app.js", "text/javascript; charset=utf-8", include_str!("app.js")),
    ("/camera.js", "text/javascript; charset=utf-8", include_str!("camera.js")),
    ("/connection.js", "text/javascript; charset=utf-8", include_str!("connection.js")),
    ("/http.js", "text/javascript; charset=utf-8", include_str!("http.js")),
    ("/jobs.js", "text/javascript; charset=utf-8", include_str!("jobs.js")),
    ("/live.js", "text/javascript; charset=utf-8", include_str!("live.js")),
    ("/player.js", "text/javascript; charset=utf-8", include_str!("player.js")),
    ("/plots.js", "text/javascript; charset=utf-8", include_str!("plots.js")),
];

/// Routes of the page's files, which need no token: they hold no data.
pub fn router() -> Router<State> {
    FILES.into_iter().fold(Router::new(), |router, (address, kind, content)| {
        // A newer program has newer files at the same addresses.
        let headers = [(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-cache")];
        router.route(address, get(async move || (headers, content).into_response()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_names_only_its_own_files_and_has_no_inline_code() {
        let page = FILES[0].2;
        for (at, _) in page.match_indices("src=\"").chain(page.match_indices("href=\"")) {
            let name = page[at..].split('"').nth(1).expect("a value");
            let is_file = FILES.iter().any(|(address, ..)| address.strip_prefix('/') == Some(name));
            assert!(is_file || name.starts_with('#'), "{name}");
        }
        assert_eq!(page.matches("<script").count(), 1);
        for inline in [" onclick=", " onload=", " style=", "javascript:"] {
            assert!(!page.contains(inline), "{inline}");
        }
        for (address, _, content) in FILES {
            let imports = content.split("from \"./").skip(1).filter_map(|rest| rest.split('"').next());
            for name in imports {
                assert!(
                    FILES.iter().any(|(other, ..)| other.strip_prefix('/') == Some(name)),
                    "{address}: {name}"
                );
            }
        }
    }
}
