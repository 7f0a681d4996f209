// Tables turned and cut to fit, and what their marks mean.
#include "experiments/report/tables.h"

namespace palpate::experiments {

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
      for (std::size_t i = 1; i < table.columns.size(); ++i)
        group.rows.push_back({{table.columns[i], false, false}});
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
      bad = bad || (row[i].bad && row[i].text != kNoNumber);
      none = none || row[i].text == kNoNumber;
    }
  std::vector<std::string> lines;
  if (best)
    lines.push_back("* " + (!table.best_means.empty() ? table.best_means
                            : is_turned               ? std::string("the best of its column")
                                                      : std::string("the best of its row")));
  if (bad) lines.push_back("! " + (table.bad_means.empty() ? "falls short" : table.bad_means));
  if (none)
    lines.push_back(std::string(kNoNumber) + " no value: not measured, or nothing to compare it with");
  return lines;
}

}  // namespace palpate::experiments
