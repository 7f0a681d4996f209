#include "experiments/stress/against.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "toolkit/core/input_file.h"

namespace palpate::experiments {
namespace {

// The matrix of all cells has some 2 MB.
constexpr std::uint64_t kMostAgainstBytes = std::uint64_t{256} << 20;

Error no_matrix(const std::string& file, const std::string& why) {
  return {fmt::format("{} is no {}: {}", file, kStressFile, why),
          "give the stress.json of another run of palpate test stress",
          {},
          0};
}

}  // namespace

Result<OtherHashes> read_hashes(const std::string& file) {
  PALPATE_ASSIGN(const std::string text, read_file(file, kMostAgainstBytes));
  OtherHashes other;
  other.file = file;
  try {
    const DocumentJson json = DocumentJson::parse(text);
    if (json.at("schema") != kStressSchema)
      return no_matrix(file, fmt::format("its schema is not {}", kStressSchema));
    const DocumentJson& machine = json.at("machine");
    other.built_by = fmt::format("{}, {}", machine.value("compiler", "an unknown compiler"),
                                 machine.value("cpu", "an unknown processor"));
    for (const DocumentJson& cell : json.at("cells")) {
      if (cell.at("status") == "skipped") continue;
      const DocumentJson& hash = cell.at("trace_hash");
      other.of_cell[{cell.at("renderer"), cell.at("case")}] = hash.is_null() ? "" : hash.get<std::string>();
    }
  } catch (const nlohmann::json::exception& error) {
    return no_matrix(file, error.what());
  }
  if (other.of_cell.empty()) return no_matrix(file, "no cell of it was run");
  return other;
}

std::vector<HashRow> compare_hashes(const StressMatrix& matrix, const OtherHashes& other) {
  std::vector<HashRow> rows;
  for (std::size_t r = 0; r < matrix.cells.size(); ++r) {
    HashRow row;
    row.renderer = matrix.renderers[r].label;
    row.role = matrix.roles[r];
    for (const StressCell& cell : matrix.cells[r]) {
      const auto theirs = other.of_cell.find({row.renderer, cell.name});
      if (cell.status == CellStatus::kSkipped || theirs == other.of_cell.end()) continue;
      if (theirs->second == cell.trace_hash)
        ++row.same;
      else
        row.different.push_back(cell.name);
    }
    if (row.same + row.different.size() > 0) rows.push_back(std::move(row));
  }
  return rows;
}

Table hash_table(const std::vector<HashRow>& rows, const OtherHashes& other) {
  Table table;
  table.title = "Trace hashes against " + other.file;
  table.bad_means = "other bits than the other run's";
  table.columns = {"renderer", "the same", "different", "in"};
  for (const HashRow& row : rows)
    table.rows.push_back({{row.renderer},
                          {format_count(row.same)},
                          {format_count(row.different.size()), false, !row.different.empty()},
                          {row.different.empty() ? "" : fmt::format("{}", fmt::join(row.different, ", "))}});
  table.notes.push_back(fmt::format("The other run: {}. Cells that both ran.", other.built_by));
  return table;
}

std::string with_hashes(const std::string& stress_json, const std::vector<HashRow>& rows,
                        const OtherHashes& other) {
  DocumentJson json = DocumentJson::parse(stress_json);
  json["against"] = {
      {"file", other.file}, {"built_by", other.built_by}, {"renderers", DocumentJson::array()}};
  for (const HashRow& row : rows)
    json["against"]["renderers"].push_back(
        {{"renderer", row.renderer}, {"same", row.same}, {"different", row.different}});
  return document_text(json);
}

}  // namespace palpate::experiments
