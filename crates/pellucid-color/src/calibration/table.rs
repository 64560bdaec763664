//! Tables of measurements as text: comma-separated values and CGATS.

use crate::ColorError;

/// Most cells that are read.
const MAX_CELLS: usize = 4 << 20;

/// A table with the lines that its rows stand on.
#[derive(Debug, PartialEq)]
pub(super) struct Table {
    pub columns: Vec<String>,
    pub rows: Vec<Row>,
    /// Whether `0,5` is a number: in tables parted by semicolons.
    pub decimal_comma: bool,
}

#[derive(Debug, PartialEq)]
pub(super) struct Row {
    /// Counted from 1.
    pub line: usize,
    /// One a column.
    pub cells: Vec<String>,
}

impl Table {
    /// CGATS where a line says `BEGIN_DATA_FORMAT`, else values parted by commas, semicolons or tabulators under a
    /// line of column names. Lines that begin with `#` are remarks.
    pub fn parse(text: &str) -> Result<Self, ColorError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let is_cgats = text.lines().any(|line| line.trim().eq_ignore_ascii_case("BEGIN_DATA_FORMAT"));
        let table = if is_cgats { cgats(text) } else { separated(text) }?;
        if table.rows.is_empty() {
            return Err(ColorError::invalid("measurements", "the table has no rows"));
        }
        if let Some(i) = (1..table.columns.len()).find(|&i| table.columns[..i].contains(&table.columns[i])) {
            let reason = format!("the column {:?} stands in it twice", table.columns[i]);
            return Err(ColorError::invalid("measurements", reason));
        }
        Ok(table)
    }

    /// Position of the first column whose name is one of `names`, capitals or not.
    pub fn column(&self, names: &[&str]) -> Option<usize> {
        self.columns.iter().position(|c| names.iter().any(|n| c.eq_ignore_ascii_case(n)))
    }

    /// The number in a cell; `None` where it is empty.
    pub fn number(&self, row: &Row, column: usize) -> Result<Option<f64>, ColorError> {
        let text = row.cells[column].trim();
        if text.is_empty() {
            return Ok(None);
        }
        let plain = if self.decimal_comma { text.replace(',', ".") } else { text.to_owned() };
        plain.parse::<f64>().ok().filter(|v| v.is_finite()).map(Some).ok_or_else(|| {
            let subject = format!("measurements, line {}, {}", row.line, self.columns[column]);
            ColorError::invalid(subject, format!("{text:?} is no number"))
        })
    }

    fn add(&mut self, line: usize, mut cells: Vec<String>) -> Result<(), ColorError> {
        let wanted = self.columns.len();
        // Spreadsheets leave empty cells at the end out, or add some.
        while cells.len() > wanted && cells.last().is_some_and(|c| c.trim().is_empty()) {
            cells.pop();
        }
        if cells.len() > wanted {
            let reason = format!("{} values for {wanted} columns", cells.len());
            return Err(ColorError::invalid(format!("measurements, line {line}"), reason));
        }
        cells.resize(wanted, String::new());
        if (self.rows.len() + 1) * wanted > MAX_CELLS {
            let reason = format!("more than the {MAX_CELLS} cells that are read");
            return Err(ColorError::unsupported("measurements", reason));
        }
        self.rows.push(Row { line, cells });
        Ok(())
    }
}

fn separated(text: &str) -> Result<Table, ColorError> {
    let mut lines = text
        .lines()
        .enumerate()
        .map(|(i, line)| (i + 1, line))
        .filter(|(_, line)| !line.trim().is_empty() && !line.trim_start().starts_with('#'));
    let (line, head) =
        lines.next().ok_or_else(|| ColorError::invalid("measurements", "the table is empty"))?;
    // What parts the names parts the values: a stack or a decimal number may hold a comma.
    let separator = ['\t', ';', ','].into_iter().find(|&c| head.contains(c)).unwrap_or(',');
    let columns = cells(head, separator, line)?.into_iter().map(|c| c.trim().to_owned()).collect();
    let mut table = Table { columns, rows: Vec::new(), decimal_comma: separator != ',' };
    for (line, text) in lines {
        table.add(line, cells(text, separator, line)?)?;
    }
    Ok(table)
}

/// The cells of a line; one in double quotes may hold the separator, and quotes doubled.
fn cells(text: &str, separator: char, line: usize) -> Result<Vec<String>, ColorError> {
    let mut cells = vec![String::new()];
    let mut quoted = false;
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        let cell = cells.len() - 1;
        match c {
            '"' if quoted && chars.peek() == Some(&'"') => {
                chars.next();
                cells[cell].push('"');
            }
            '"' if quoted => quoted = false,
            '"' if cells[cell].trim().is_empty() => {
                cells[cell].clear();
                quoted = true;
            }
            c if c == separator && !quoted => cells.push(String::new()),
            c => cells[cell].push(c),
        }
    }
    if quoted {
        return Err(ColorError::invalid(format!("measurements, line {line}"), "a quote is not closed"));
    }
    Ok(cells)
}

/// CGATS.17: names between `BEGIN_DATA_FORMAT` and `END_DATA_FORMAT`, values between `BEGIN_DATA` and `END_DATA`, all
/// parted by blanks; text in quotes.
fn cgats(text: &str) -> Result<Table, ColorError> {
    #[derive(PartialEq)]
    enum Part {
        Head,
        Format,
        Data,
    }
    let mut table = Table { columns: Vec::new(), rows: Vec::new(), decimal_comma: false };
    let mut part = Part::Head;
    for (i, text) in text.lines().enumerate() {
        let (line, text) = (i + 1, text.trim());
        let is = |word: &str| text.eq_ignore_ascii_case(word);
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        match part {
            Part::Head if is("BEGIN_DATA_FORMAT") && table.columns.is_empty() => part = Part::Format,
            Part::Head if is("BEGIN_DATA") => part = Part::Data,
            Part::Format if is("END_DATA_FORMAT") => part = Part::Head,
            // Further tables of the file are other things.
            Part::Data if is("END_DATA") => return Ok(table),
            Part::Head => {}
            Part::Format => table.columns.extend(words(text, line)?),
            Part::Data => {
                let cells = words(text, line)?;
                if cells.len() != table.columns.len() {
                    let reason = format!("{} values for {} columns", cells.len(), table.columns.len());
                    return Err(ColorError::invalid(format!("measurements, line {line}"), reason));
                }
                table.add(line, cells)?;
            }
        }
    }
    Err(ColorError::invalid("measurements", "END_DATA is missing; the file may be cut off"))
}

fn words(text: &str, line: usize) -> Result<Vec<String>, ColorError> {
    let mut words = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        let (word, after) = if let Some(quoted) = rest.strip_prefix('"') {
            quoted.split_once('"').ok_or_else(|| {
                ColorError::invalid(format!("measurements, line {line}"), "a quote is not closed")
            })?
        } else {
            rest.split_at(rest.find(char::is_whitespace).unwrap_or(rest.len()))
        };
        words.push(word.to_owned());
        rest = after.trim_start();
    }
    Ok(words)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_ways_of_writing_a_table_give_the_same() {
        let comma = "# a remark\npatch,stack,L\nA1,\"cyan 0.1 / white\",50.5\n\nA2,white,90\n";
        let semicolon = "patch;stack;L\r\nA1;cyan 0.1 / white;50,5\r\nA2;white;90;\r\n";
        let tab = "\u{feff}patch\tstack\tL\nA1\tcyan 0.1 / white\t50.5\nA2\twhite\t90\n";
        let cgats = "CGATS.17\nORIGINATOR \"x\"\nBEGIN_DATA_FORMAT\npatch stack\nL\nEND_DATA_FORMAT\n\
                     BEGIN_DATA\nA1 \"cyan 0.1 / white\" 50.5\nA2 white 90\nEND_DATA\nnonsense \" here\n";
        for text in [comma, semicolon, tab, cgats] {
            let table = Table::parse(text).unwrap();
            assert_eq!(table.columns, ["patch", "stack", "L"]);
            assert_eq!(table.rows[0].cells[1], "cyan 0.1 / white");
            let values: Vec<_> = table.rows.iter().map(|r| table.number(r, 2).unwrap().unwrap()).collect();
            assert_eq!(values, [50.5, 90.0]);
        }
        assert_eq!(Table::parse(comma).unwrap().rows[1].line, 5);
    }

    #[test]
    fn what_is_no_table_is_told_by_line() {
        for (text, part) in [
            ("", "empty"),
            ("patch,L\n", "no rows"),
            ("patch,L,L\nA,1,2\n", "twice"),
            ("patch,L\nA,1\nB,1,2\n", "line 3: 3 values"),
            ("patch,L\nA,\"1\nB\",1\n", "line 2: a quote"),
            ("BEGIN_DATA_FORMAT\nA B\nEND_DATA_FORMAT\nBEGIN_DATA\n1 2\n", "END_DATA"),
            ("BEGIN_DATA_FORMAT\nA B\nEND_DATA_FORMAT\nBEGIN_DATA\n1\nEND_DATA\n", "line 5: 1 values"),
        ] {
            let error = Table::parse(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text:?}: {error}");
        }
        let table = Table::parse("patch,L\nA,x\nB,inf\nC,\n").unwrap();
        assert!(table.number(&table.rows[0], 1).unwrap_err().to_string().contains("line 2, L: \"x\""));
        assert!(table.number(&table.rows[1], 1).is_err());
        assert_eq!(table.number(&table.rows[2], 1), Ok(None));
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "(BEGIN_DATA_FORMAT\n|BEGIN_DATA\n|END_DATA\n|[ -~\n\t;,\"]){0,60}") {
            if let Ok(table) = Table::parse(&text) {
                prop_assert!(table.rows.iter().all(|row| row.cells.len() == table.columns.len()));
            }
        }
    }
}
