// Tables of the report.
#include <fmt/format.h>

#include <algorithm>

#include "experiments/report/tables.h"

namespace palpate::experiments {
namespace {

/// More columns of renderers than this do not stand beside the names of the scores on a sheet of A4.
constexpr std::size_t kMostRenderers = 6;
/// The same for scores beside the names of renderers.
constexpr std::size_t kMostScores = 8;

std::string cell_html(const Cell& cell, bool words) {
  const bool bad = cell.bad && cell.text != kNoNumber;
  std::string kind = words ? "words" : "";
  if (cell.best || bad) kind += fmt::format("{}{}", words ? " " : "", cell.best ? "best" : "bad");
  return fmt::format("<td{}>{}{}</td>", kind.empty() ? "" : " class=\"" + kind + "\"",
                     html_escaped(cell.text),
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
    html += "<tr><th scope=\"row\">" + html_escaped(row[0].text) + "</th>";
    for (std::size_t i = 1; i < row.size(); ++i) html += cell_html(row[i], words[i]);
    html += "</tr>\n";
  }
  return html + "</tbody></table></div>\n";
}

}  // namespace

std::string html_escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default:
        out += c;
    }
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
