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

/// The median of values; `None` of none.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    Some(0.5 * (values[last / 2] + values[last.div_ceil(2)]))
}
