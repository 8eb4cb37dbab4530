//! Pages of studies that need no other file.

use mammotwin_stages::report::escaped;

/// The beginning of a page, up to what it says of itself; `style` is what it adds to the common one.
pub fn begin(title: &str, subject: &str, style: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\n\
         <style>body{{font:16px/1.5 sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;\
         color:#222}}{style}</style></head><body>\n<h1>{title}</h1>\n<p>{}. A research result, not a medical \
         device; nothing here is a diagnosis.</p>\n",
        escaped(subject)
    )
}

/// Style of pages with tables of numbers and figures beside each other.
pub const FIGURES_AND_TABLES: &str = "table{border-collapse:collapse;font-size:14px;margin:1em 0}\
     th,td{padding:.25em .6em;border-bottom:1px solid #ddd;text-align:right}\
     th:first-child,td:first-child{text-align:left}figure{display:inline-block;margin:.5em;\
     vertical-align:top}figure svg{width:520px;height:auto}\
     figcaption{font-size:13px;color:#555;max-width:520px}";

/// A number of a table, with three digits or more.
pub fn number(value: f64) -> String {
    // No minus before a zero.
    let value = if value.abs() < 5e-4 { 0.0 } else { value };
    match value.abs() {
        _ if !value.is_finite() => "–".into(),
        size if size >= 100.0 => format!("{value:.0}"),
        size if size >= 10.0 => format!("{value:.1}"),
        size if size >= 1.0 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

/// A number with one standard deviation, where there is one.
pub fn give_or_take(value: f64, sd: f64) -> String {
    let text = number(value);
    if value.is_finite() && sd.is_finite() { format!("{text} ± {}", number(sd)) } else { text }
}

/// A table of texts under their headings.
pub fn table(head: &[String], rows: &[Vec<String>]) -> String {
    let cells = |tag: &str, row: &[String]| {
        let cell = |text: &String| format!("<{tag}>{}</{tag}>", escaped(text));
        format!("<tr>{}</tr>\n", row.iter().map(cell).collect::<String>())
    };
    let body: String = rows.iter().map(|row| cells("td", row)).collect();
    format!("<table>\n{}{body}</table>\n", cells("th", head))
}

/// A value of a CSV file in quotes, on one line.
pub fn quoted(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    format!("\"{}\"", line.replace('"', "\"\""))
}

/// The median of values; `None` of none.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    Some(0.5 * (values[last / 2] + values[last.div_ceil(2)]))
}
