// Tables of the report; turned and cut to fit, and what their marks mean.
#include <fmt/format.h>

#include <algorithm>

#include "experiments/report/tables.h"

namespace palpate::experiments {
namespace {

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
