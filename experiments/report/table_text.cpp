// Tables on a terminal.
#include <algorithm>
#include <numeric>

#include "experiments/report/tables.h"

namespace palpate::experiments {
namespace {

constexpr std::size_t kIndent = 2, kGap = 2;
constexpr std::size_t kNameColumns = 24;   // the first column keeps so many
constexpr std::size_t kLeastColumns = 20;  // of a terminal: below it lines run over rather than vanish

std::string padded(const std::string& text, std::size_t to, bool right) {
  const std::size_t width = text_width(text);
  const std::string blanks(to > width ? to - width : 0, ' ');
  return right ? blanks + text : text + blanks;
}

struct Word {
  std::string text;
  bool glued = false;  ///< to the one before it, which ends with a hyphen
};

/// A hyphen ends a word only between letters: not in 1e-3 or -5.
std::vector<Word> words_of(const std::string& text) {
  const auto letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
  std::vector<Word> words(1);
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == ' ') {
      if (!words.back().text.empty()) words.emplace_back();
      continue;
    }
    words.back().text += text[i];
    if (text[i] == '-' && i > 0 && i + 1 < text.size() && letter(text[i - 1]) && letter(text[i + 1]))
      words.push_back({"", true});
  }
  if (words.back().text.empty()) words.pop_back();
  return words;
}

/// One table with the widths of its columns.
struct Layout {
  std::vector<std::size_t> widths;
  std::vector<bool> words;
  std::vector<bool> marks;  ///< the column keeps a place behind its numbers
};

std::string marked(const Cell& cell, bool room) {
  return cell.text + (cell.best ? "*" : cell.bad && cell.text != kMissingNumber ? "!" : room ? " " : "");
}

std::size_t longest_word(const std::string& text) {
  std::size_t longest = 0;
  for (const Word& word : words_of(text)) longest = std::max(longest, text_width(word.text));
  return longest;
}

/// Widths that suit `columns`, or the least there can be: headings give way first, then the longest texts.
Layout lay_out(const Table& table, std::size_t columns) {
  const std::size_t n = table.columns.size();
  Layout layout{std::vector<std::size_t>(n), std::vector<bool>(n), std::vector<bool>(n)};
  std::vector<std::size_t> cells(n, 0), least(n, 0);
  for (std::size_t i = 0; i < n; ++i) {
    layout.words[i] = i == 0 || holds_words(table, i);
    for (const auto& row : table.rows)
      if (row.size() > 1 && (row[i].best || (row[i].bad && row[i].text != kMissingNumber)))
        layout.marks[i] = true;
    least[i] = longest_word(table.columns[i]);
    for (const auto& row : table.rows) {
      if (row.size() == 1) continue;
      const std::string text = marked(row[i], layout.marks[i]);
      cells[i] = std::max(cells[i], text_width(text));
      least[i] = std::max(least[i], longest_word(text) + (layout.marks[i] ? 1 : 0));
      // What a row is about is not broken into scraps: rather fewer columns.
      if (i == 0) least[i] = std::max(least[i], std::min(text_width(text), kNameColumns));
    }
    cells[i] = std::max(cells[i], least[i]);
    layout.widths[i] = std::max(cells[i], text_width(table.columns[i]));
  }
  const auto give_way = [&](const std::vector<std::size_t>& to) {
    while (kIndent + (n - 1) * kGap +
               std::accumulate(layout.widths.begin(), layout.widths.end(), std::size_t{0}) >
           columns) {
      std::size_t widest = n;
      for (std::size_t i = 0; i < n; ++i)
        if (layout.widths[i] > to[i] && (widest == n || layout.widths[i] > layout.widths[widest])) widest = i;
      if (widest == n) return;
      --layout.widths[widest];
    }
  };
  give_way(cells);
  give_way(least);
  return layout;
}

std::size_t width_of(const Layout& layout) {
  return kIndent + (layout.widths.size() - 1) * kGap +
         std::accumulate(layout.widths.begin(), layout.widths.end(), std::size_t{0});
}

std::string without_end_blanks(std::string line) {
  while (!line.empty() && line.back() == ' ') line.pop_back();
  return line + "\n";
}

/// One row, as many lines as its longest cell needs; headings stand at the bottom.
std::string row_text(const std::vector<std::string>& cells, const Layout& layout, bool heading) {
  std::vector<std::vector<std::string>> lines;
  std::size_t height = 1;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    lines.push_back(text_width(cells[i]) <= layout.widths[i] ? std::vector<std::string>{cells[i]}
                                                             : wrapped(cells[i], layout.widths[i]));
    height = std::max(height, lines.back().size());
  }
  std::string text;
  for (std::size_t k = 0; k < height; ++k) {
    std::string line(kIndent, ' ');
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const std::size_t above = heading ? height - lines[i].size() : 0;
      const bool there = k >= above && k - above < lines[i].size();
      if (i > 0) line += std::string(kGap, ' ');
      line += padded(there ? lines[i][k - above] : "", layout.widths[i], !layout.words[i]);
    }
    text += without_end_blanks(std::move(line));
  }
  return text;
}

std::string body_text(const Table& table, std::size_t columns) {
  const Layout layout = lay_out(table, columns);
  const std::size_t n = table.columns.size();
  if (width_of(layout) > columns && n > 2) {
    // As many columns as fit, at least one; the rest below, in parts of about the same size.
    std::size_t end = n - 1;
    while (end > 2 && width_of(lay_out(part_of(table, 1, end), columns)) > columns) --end;
    const std::size_t parts = (n - 1 + end - 2) / (end - 1);
    end = 1 + (n - 1 + parts - 1) / parts;
    return body_text(part_of(table, 1, end), columns) + "\n" + body_text(part_of(table, end, n), columns);
  }
  std::string text = row_text(table.columns, layout, true);
  for (const auto& row : table.rows) {
    if (row.size() == 1) {
      text += row[0].text + "\n";
      continue;
    }
    std::vector<std::string> cells;
    for (std::size_t i = 0; i < n; ++i) cells.push_back(marked(row[i], layout.marks[i]));
    text += row_text(cells, layout, false);
  }
  return text;
}

std::string paragraph(const std::string& text, std::size_t columns) {
  std::string lines;
  for (const std::string& line : wrapped(text, columns - kIndent))
    lines += std::string(kIndent, ' ') + line + "\n";
  return lines;
}

}  // namespace

std::size_t text_width(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

bool holds_words(const Table& table, std::size_t column) {
  std::size_t words = 0, all = 0;
  for (const auto& row : table.rows) {
    if (row.size() == 1 || row[column].text.empty() || row[column].text == kMissingNumber) continue;
    ++all;
    const char c = row[column].text.front();
    words += (c >= '0' && c <= '9') || c == '<' || c == '>' || c == '-' ? 0u : 1u;
  }
  return 2 * words > all;
}

std::vector<std::string> wrapped(const std::string& text, std::size_t columns) {
  std::vector<std::string> lines;
  std::string line;
  for (const Word& word : words_of(text)) {
    std::string longer = line + (line.empty() || word.glued ? "" : " ") + word.text;
    if (!line.empty() && text_width(longer) > columns) {
      lines.push_back(std::move(line));
      longer = word.text;
    }
    line = std::move(longer);
  }
  if (!line.empty() || lines.empty()) lines.push_back(std::move(line));
  return lines;
}

std::string to_text(const Table& table, std::size_t columns) {
  columns = std::max(columns, kLeastColumns);
  std::string text;
  if (!table.title.empty())
    for (const std::string& line : wrapped(table.title, columns)) text += line + "\n";
  const bool turn = table.turns && width_of(lay_out(table, columns)) > columns;
  if (!turn) text += body_text(table, columns);
  if (turn)
    for (const Table& group : turned(table)) {
      if (!group.title.empty()) text += "\n" + group.title + "\n";
      text += body_text(group, columns);
    }
  text += "\n";
  for (const std::string& line : legend_of(table, turn)) text += paragraph(line, columns);
  if (!table.caption.empty()) text += paragraph(table.caption, columns);
  for (const std::string& note : table.notes) text += paragraph(note, columns);
  while (text.ends_with("\n\n")) text.pop_back();
  return text;
}

}  // namespace palpate::experiments
