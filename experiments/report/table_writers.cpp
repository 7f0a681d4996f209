#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "experiments/report/tables.h"

namespace palpate::experiments {
namespace {

// Tables on a terminal.

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
      // A row's subject is not broken into scraps: rather fewer columns.
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

namespace {

// Tables of the report; turned and cut to fit, and what their marks mean.

/// More columns of renderers than this do not stand beside the names of the scores on a sheet of A4.
constexpr std::size_t kMostRenderers = 6;
/// The same for scores beside the names of renderers.
constexpr std::size_t kMostScores = 8;

std::string linked_text(const Cell& cell) {
  const std::string text = html_escaped(cell.text);
  return cell.link.empty() ? text : fmt::format("<a href=\"{}\">{}</a>", html_escaped(cell.link), text);
}

std::string cell_html(const Cell& cell, bool words) {
  const bool bad = cell.bad && cell.text != kMissingNumber;
  std::string kind = words ? "words" : "";
  if (cell.best || bad) kind += fmt::format("{}{}", words ? " " : "", cell.best ? "best" : "bad");
  return fmt::format("<td{}>{}{}</td>", kind.empty() ? "" : " class=\"" + kind + "\"", linked_text(cell),
                     cell.best ? "<span class=\"mark\">*</span>"
                     : bad     ? "<span class=\"mark\">!</span>"
                               : "");
}

/// "n12": the style sheet sets tables of many columns smaller on paper. `kind` is a class too.
std::string table_html(const Table& table, const std::string& title, const char* kind) {
  std::string html =
      fmt::format("<div class=\"scroll\"><table class=\"{}n{}\">\n", kind, table.columns.size());
  if (!title.empty()) html += "<caption>" + html_escaped(title) + "</caption>\n";
  html += "<thead><tr>";
  std::vector<bool> words;
  for (std::size_t i = 0; i < table.columns.size(); ++i) {
    words.push_back(holds_words(table, i));
    html += fmt::format("<th scope=\"col\"{}>{}</th>", words.back() ? " class=\"words\"" : "",
                        html_escaped(table.columns[i]));
  }
  html += "</tr></thead>\n<tbody>\n";
  for (const auto& row : table.rows) {
    if (row.size() == 1) {
      html += fmt::format("<tr class=\"group\"><th colspan=\"{}\">{}</th></tr>\n", table.columns.size(),
                          html_escaped(row[0].text));
      continue;
    }
    html += "<tr><th scope=\"row\">" + linked_text(row[0]) + "</th>";
    for (std::size_t i = 1; i < row.size(); ++i) html += cell_html(row[i], words[i]);
    html += "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

}  // namespace

std::vector<Table> turned(const Table& table) {
  std::vector<Table> groups;
  for (const auto& row : table.rows) {
    const bool heading = row.size() == 1;
    // A lone row before the first heading (the status) goes with what follows.
    if (heading && groups.size() == 1 && groups[0].title.empty() && groups[0].columns.size() == 2) {
      groups[0].title = row[0].text;
    } else if (heading || groups.empty()) {
      Table& group = groups.emplace_back();
      group.title = heading ? row[0].text : "";
      group.columns = {table.columns.empty() || table.columns[0].empty() ? "" : table.columns[0]};
      for (std::size_t i = 1; i < table.columns.size(); ++i) group.rows.push_back({plain(table.columns[i])});
    }
    if (heading) continue;
    groups.back().columns.push_back(row[0].text);
    for (std::size_t i = 1; i < row.size(); ++i) groups.back().rows[i - 1].push_back(row[i]);
  }
  return groups;
}

Table part_of(const Table& table, std::size_t begin, std::size_t end) {
  const auto some = [&](const auto& row) {
    auto part = row;
    part.erase(part.begin() + static_cast<std::ptrdiff_t>(end), part.end());
    part.erase(part.begin() + 1, part.begin() + static_cast<std::ptrdiff_t>(begin));
    return part;
  };
  Table part;
  part.columns = some(table.columns);
  for (const auto& row : table.rows) part.rows.push_back(row.size() == 1 ? row : some(row));
  return part;
}

std::vector<std::string> legend_of(const Table& table, bool is_turned) {
  bool best = false, bad = false, none = false;
  for (const auto& row : table.rows)
    for (std::size_t i = 1; i < row.size(); ++i) {
      best = best || row[i].best;
      bad = bad || (row[i].bad && row[i].text != kMissingNumber);
      none = none || row[i].text == kMissingNumber;
    }
  std::vector<std::string> lines;
  if (best)
    lines.push_back("* " + (!table.best_means.empty() ? table.best_means
                            : is_turned               ? std::string("the best of its column")
                                                      : std::string("the best of its row")));
  if (bad) lines.push_back("! " + (table.bad_means.empty() ? "falls short" : table.bad_means));
  if (none)
    lines.push_back(std::string(kMissingNumber) + " no value: not measured, or nothing to compare it with");
  return lines;
}

std::string html_escaped(const std::string& text) {
  static constexpr std::pair<char, const char*> kNames[] = {
      {'&', "&amp;"}, {'<', "&lt;"}, {'>', "&gt;"}, {'"', "&quot;"}, {'\'', "&#39;"}};
  std::string out;
  for (const char c : text) {
    const auto* const named =
        std::find_if(std::begin(kNames), std::end(kNames), [c](const auto& one) { return one.first == c; });
    if (named == std::end(kNames))
      out += c;
    else
      out += named->second;
  }
  return out;
}

std::string to_html(const Table& table) {
  const bool turn = table.turns && table.columns.size() > kMostRenderers + 1;
  std::string html;
  if (turn) {
    if (!table.title.empty()) html += "<h3>" + html_escaped(table.title) + "</h3>\n";
    for (const Table& group : turned(table)) {
      // Groups of more scores than a sheet holds go on below, in parts of about the same size.
      const std::size_t scores = group.columns.size() - 1, parts = (scores + kMostScores - 1) / kMostScores;
      for (std::size_t k = 0; k < parts; ++k)
        html += table_html(part_of(group, 1 + k * scores / parts, 1 + (k + 1) * scores / parts),
                           k == 0 ? group.title : group.title + ", continued", "turned ");
    }
  } else {
    html += table_html(table, table.title, "");
  }
  std::string legend;
  for (const std::string& line : legend_of(table, turn)) legend += "<span>" + html_escaped(line) + "</span> ";
  if (!legend.empty()) html += "<p class=\"legend\">" + legend + "</p>\n";
  if (!table.caption.empty()) html += "<p class=\"caption\">" + html_escaped(table.caption) + "</p>\n";
  if (table.notes.empty()) return html;
  html += "<ul class=\"notes\">";
  for (const std::string& note : table.notes) html += "<li>" + html_escaped(note) + "</li>";
  return html + "</ul>\n";
}

}  // namespace palpate::experiments
