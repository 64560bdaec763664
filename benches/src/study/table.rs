//! Rows as Markdown and CSV.

/// Columns with titles, and rows of as many cells.
#[derive(Clone, Debug)]
pub struct Table {
    columns: Vec<Column>,
    rows: Vec<Vec<String>>,
}

#[derive(Clone, Debug)]
struct Column {
    title: String,
    right: bool,
}

impl Table {
    /// A table of these columns; a title that begins with `>` stands right, as numbers do.
    ///
    /// ```
    /// use pellucid_benches::study::Table;
    /// let mut table = Table::new(&["scene", ">paths"]);
    /// table.row(["ball, white".into(), "16".into()]);
    /// assert_eq!(table.markdown(), "| scene | paths |\n| --- | ---: |\n| ball, white | 16 |\n");
    /// assert_eq!(table.csv(), "scene,paths\n\"ball, white\",16\n");
    /// ```
    pub fn new(columns: &[&str]) -> Self {
        let columns = columns.iter().map(|title| {
            let right = title.starts_with('>');
            Column { title: title.trim_start_matches('>').to_owned(), right }
        });
        Self { columns: columns.collect(), rows: Vec::new() }
    }

    /// Adds a row.
    ///
    /// # Panics
    /// When it has another number of cells than there are columns.
    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        let cells: Vec<String> = cells.into_iter().collect();
        assert_eq!(cells.len(), self.columns.len(), "a cell for each column");
        self.rows.push(cells);
    }

    /// A Markdown table.
    pub fn markdown(&self) -> String {
        let line = |cells: &mut dyn Iterator<Item = String>| {
            let cells: Vec<String> = cells.map(|cell| cell.replace('|', "\\|")).collect();
            format!("| {} |\n", cells.join(" | "))
        };
        let mut out = line(&mut self.columns.iter().map(|c| c.title.clone()));
        out += &line(&mut self.columns.iter().map(|c| if c.right { "---:" } else { "---" }.to_owned()));
        for row in &self.rows {
            out += &line(&mut row.iter().cloned());
        }
        out
    }

    /// Comma-separated values, quoted where they must be (RFC 4180).
    pub fn csv(&self) -> String {
        let line = |cells: &mut dyn Iterator<Item = &str>| {
            let cells: Vec<String> = cells
                .map(|cell| match cell.contains([',', '"', '\n']) {
                    true => format!("\"{}\"", cell.replace('"', "\"\"")),
                    false => cell.to_owned(),
                })
                .collect();
            cells.join(",") + "\n"
        };
        let mut out = line(&mut self.columns.iter().map(|c| c.title.as_str()));
        for row in &self.rows {
            out += &line(&mut row.iter().map(String::as_str));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_that_hold_separators_are_quoted() {
        let mut table = Table::new(&["a", ">b"]);
        table.row(["say \"x\"".into(), "1,5".into()]);
        table.row(["a|b".into(), "2".into()]);
        assert_eq!(table.csv(), "a,b\n\"say \"\"x\"\"\",\"1,5\"\na|b,2\n");
        assert!(table.markdown().ends_with("| a\\|b | 2 |\n"));
    }
}
