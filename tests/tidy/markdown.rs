//! Markdown, as far as the rules need it.

use super::text::{line_of, regex};

/// A fenced block of code.
#[derive(Debug)]
pub struct Block<'a> {
    /// What follows the opening fence.
    pub language: &'a str,
    /// Its lines with their numbers.
    pub lines: Vec<(usize, &'a str)>,
    /// The last line before it that is not empty.
    pub before: &'a str,
}

/// A table: cells without the spaces around them.
#[derive(Debug)]
pub struct Table {
    pub header: Vec<String>,
    /// Rows with their lines.
    pub rows: Vec<(usize, Vec<String>)>,
}

impl Table {
    /// The column whose title contains a word.
    pub fn column(&self, word: &str) -> Option<usize> {
        self.header.iter().position(|title| title.to_lowercase().contains(word))
    }
}

/// All fenced blocks.
pub fn blocks(text: &str) -> Vec<Block<'_>> {
    let mut blocks = Vec::new();
    let mut open: Option<Block<'_>> = None;
    let mut before = "";
    for (index, line) in text.lines().enumerate() {
        let fence = line.trim_start().strip_prefix("```");
        match (&mut open, fence) {
            (Some(_), Some(_)) => {
                blocks.extend(open.take());
                before = "";
            }
            (Some(block), None) => block.lines.push((index + 1, line)),
            (None, Some(language)) => {
                open = Some(Block { language: language.trim(), lines: Vec::new(), before })
            }
            (None, None) if !line.trim().is_empty() => before = line.trim(),
            (None, None) => {}
        }
    }
    blocks
}

/// The text with fenced blocks blank: lines stay.
pub fn prose(text: &str) -> String {
    let mut fenced = false;
    let mut kept = String::with_capacity(text.len());
    for line in text.lines() {
        let fence = line.trim_start().starts_with("```");
        if !fence && !fenced {
            kept.push_str(line);
        }
        fenced ^= fence;
        kept.push('\n');
    }
    kept
}

/// Inline code of prose with the lines where it begins; a span may go on in the next line of its paragraph.
pub fn inline_code(prose: &str) -> Vec<(usize, String)> {
    let mut spans = Vec::new();
    let mut at = 0;
    while let Some(found) = prose[at..].find('`') {
        let start = at + found;
        let ticks = prose[start..].bytes().take_while(|&byte| byte == b'`').count();
        let from = start + ticks;
        let paragraph = prose[from..].find("\n\n").map_or(prose.len(), |end| from + end);
        let Some(len) = prose[from..paragraph].find(&"`".repeat(ticks)) else {
            at = from;
            continue;
        };
        let code = prose[from..from + len].split_whitespace().collect::<Vec<_>>().join(" ");
        spans.push((line_of(prose, start), code));
        at = from + len + ticks;
    }
    spans
}

/// Prose with inline code blank.
pub fn without_code(prose: &str) -> String {
    let mut text = prose.to_string();
    let spans = regex(r"`[^`]+`");
    while let Some(span) = spans.find(&text).map(|found| found.range()) {
        let blank: String = text[span.clone()].chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect();
        text.replace_range(span, &blank);
    }
    text
}

/// Targets of links and pictures with their lines.
pub fn links(text: &str) -> Vec<(usize, String)> {
    let prose = without_code(&prose(text));
    let inline = regex(r"\]\(\s*<?([^)>\s]+)>?[^)]*\)");
    let reference = regex(r"(?m)^\s*\[[^\]]+\]:\s+<?(\S+?)>?\s*$");
    let found = inline.captures_iter(&prose).chain(reference.captures_iter(&prose));
    found.map(|link| (line_of(&prose, link.get(1).expect("a target").start()), link[1].to_string())).collect()
}

/// Headings with their lines and levels.
pub fn headings(text: &str) -> Vec<(usize, usize, String)> {
    let prose = prose(text);
    let heading = |(index, line): (usize, &str)| {
        let level = line.bytes().take_while(|&byte| byte == b'#').count();
        let title = line[level..].strip_prefix(' ')?;
        (1..=6).contains(&level).then(|| (index + 1, level, title.trim().to_string()))
    };
    prose.lines().enumerate().filter_map(heading).collect()
}

/// The anchors that headings have on the usual sites: a repeated title gets a number.
pub fn anchors(text: &str) -> Vec<String> {
    let mut anchors: Vec<String> = Vec::new();
    for (_, _, title) in headings(text) {
        let title = title.to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        let slug: String = kept.map(|c| if c == ' ' { '-' } else { c }).collect();
        let earlier = anchors.iter().filter(|anchor| **anchor == slug).count();
        anchors.push(if earlier == 0 { slug } else { format!("{slug}-{earlier}") });
    }
    anchors
}

/// Lines of the section under the first heading whose title contains some text: up to the next heading that is not
/// below it.
pub fn section<'a>(text: &'a str, title: &str) -> Option<Vec<(usize, &'a str)>> {
    let headings = headings(text);
    let wanted = title.to_lowercase();
    let index = headings.iter().position(|(_, _, heading)| heading.to_lowercase().contains(&wanted))?;
    let (first, level, _) = &headings[index];
    let next = headings[index + 1..].iter().find(|(_, below, _)| below <= level);
    let end = next.map_or(usize::MAX, |(line, _, _)| *line);
    let within = |number: usize| number > *first && number < end;
    Some(
        text.lines().enumerate().map(|(index, line)| (index + 1, line)).filter(|(n, _)| within(*n)).collect(),
    )
}

/// All tables.
pub fn tables(text: &str) -> Vec<Table> {
    let prose = prose(text);
    let lines: Vec<&str> = prose.lines().collect();
    let mut tables: Vec<Table> = Vec::new();
    let mut inside = false;
    for (index, line) in lines.iter().enumerate() {
        let is_rule = |line: &str| line.contains("--") && line.chars().all(|c| "|-: ".contains(c));
        if !line.trim_start().starts_with('|') {
            inside = false;
        } else if lines.get(index + 1).is_some_and(|next| is_rule(next)) {
            tables.push(Table { header: cells(line), rows: Vec::new() });
            inside = true;
        } else if inside
            && !is_rule(line)
            && let Some(table) = tables.last_mut()
        {
            table.rows.push((index + 1, cells(line)));
        }
    }
    tables
}

/// The cells of a row; a bar behind a backslash or within inline code parts nothing.
fn cells(line: &str) -> Vec<String> {
    let line = line.trim().trim_start_matches('|');
    let mut cells = vec![String::new()];
    let (mut code, mut escaped) = (false, false);
    for c in line.chars() {
        code ^= c == '`';
        if c == '|' && !code && !escaped {
            cells.push(String::new());
        } else if let Some(cell) = cells.last_mut() {
            cell.push(c);
        }
        escaped = c == '\\';
    }
    if line.ends_with('|') {
        cells.pop();
    }
    cells.iter().map(|cell| cell.trim().to_string()).collect()
}

/// What a page has its reader make: names in comments `<!-- new: examples/mine.rs, mine -->`.
pub fn introduced(text: &str) -> Vec<String> {
    let comments = regex(r"<!-- new: (.*?) -->");
    let lists = comments.captures_iter(text).map(|found| found[1].to_string());
    lists.flat_map(|list| list.split(',').map(|name| name.trim().to_string()).collect::<Vec<_>>()).collect()
}

/// Names within backticks in a cell or line.
pub fn names(cell: &str) -> Vec<String> {
    inline_code(cell).into_iter().map(|(_, code)| code).collect()
}

#[test]
fn blocks_prose_and_inline_code() {
    let text = "one `a b`\n\n<!-- run -->\n```sh\nraystream `x`\n```\n`two\nlines` ``b`c``\n";
    let found = blocks(text);
    assert_eq!(
        (found[0].language, found[0].lines[0], found[0].before),
        ("sh", (5, "raystream `x`"), "<!-- run -->")
    );
    let code = inline_code(&prose(text));
    assert_eq!(code, [(1, "a b".into()), (7, "two lines".into()), (8, "b`c".into())]);
}

#[test]
fn headings_links_and_sections() {
    let text = "# A `b`, c\nsee [x](y.md#z) and ![p](q.png)\n## D\nin\n## D\nout\n[r]: s.md\n";
    assert_eq!(anchors(text), ["a-b-c", "d", "d-1"]);
    assert_eq!(links(text), [(2, "y.md#z".into()), (2, "q.png".into()), (7, "s.md".into())]);
    assert_eq!(section(text, "d").unwrap(), [(4, "in")]);
    assert!(section(text, "e").is_none());
}

#[test]
fn tables_have_cells() {
    let table = &tables("x\n| a | b |\n|---|:-:|\n| `c|d` | e |\n\nz\n")[0];
    assert_eq!((table.column("a"), table.column("z")), (Some(0), None));
    assert_eq!(table.rows, [(4, vec!["`c|d`".to_string(), "e".to_string()])]);
}
