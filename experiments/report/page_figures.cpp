#include "experiments/report/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <regex>

#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kFolder = "docs/figures";
constexpr const char* kEnd = "<!-- end of figures -->";
constexpr double kMsPerS = 1000.0;

/// A value that a template asks for.
struct Asked {
  std::string document;  ///< "table7/result.json"; empty: a key of the results themselves
  std::string path;      ///< "renderers[cloud].frame.mean_us"
  std::string unit;
};

Asked asked_by(const std::string& words) {
  const std::regex blank(" ");
  std::vector<std::string> word(std::sregex_token_iterator(words.begin(), words.end(), blank, -1), {});
  if (word.size() == 1) return {"", word[0], ""};
  const bool whole = word[0].ends_with(".json");
  const std::size_t before_unit = whole ? 2 : 3;
  word.resize(std::max(word.size(), before_unit + 1));
  if (whole) return {word[0], word[1], word[2]};
  return {word[0] + "/result.json", fmt::format("renderers[{}].{}", word[1], word[2]), word[3]};
}

/// A step of a path: a key, and in a list the name of an entry.
struct Key {
  std::string name, entry;
};

std::vector<Key> keys_of(const std::string& path) {
  static const std::regex kStep(R"(([^.\[\]]+)(?:\[([^\]]+)\])?)");
  std::vector<Key> keys;
  for (std::sregex_iterator at(path.begin(), path.end(), kStep), end; at != end; ++at)
    keys.push_back({(*at)[1], (*at)[2]});
  return keys;
}

/// Key of an entry of a list.
const char* name_of_entry(const Json& entry) {
  return entry.contains("label") ? "label" : "model";
}

/// The entry of a list with this name, or its end.
template <class List>
auto named(List& list, const std::string& name) {
  return std::find_if(list.begin(), list.end(),
                      [&](const Json& one) { return one.value(name_of_entry(one), "") == name; });
}

const Json* find(const Json& document, const std::string& path) {
  const Json* at = &document;
  for (const Key& key : keys_of(path)) {
    if (!at->is_object() || !at->contains(key.name)) return nullptr;
    at = &at->at(key.name);
    if (key.entry.empty()) continue;
    const auto entry = named(*at, key.entry);
    if (entry == at->end()) return nullptr;
    at = &*entry;
  }
  return at;
}

/// A preparation of which a part came from a cache was measured on another day: no page may show it.
bool is_of_another_day(const Json& document, const std::string& path) {
  static const std::string kPreparation = ".total_ms";
  if (!path.ends_with(kPreparation)) return false;
  const Json* cached = find(document, path.substr(0, path.size() - kPreparation.size()) + ".from_cache");
  return cached != nullptr && *cached == true;
}

/// Copies one value, with the names of the entries on its way.
void copy_value(const Json& from, const std::string& path, Json& into) {
  const Json* source = &from;
  Json* at = &into;
  for (const Key& key : keys_of(path)) {
    source = &source->at(key.name);
    at = &(*at)[key.name];
    if (key.entry.empty()) continue;
    source = &*named(*source, key.entry);
    auto entry = named(*at, key.entry);
    if (entry == at->end()) {
      at->push_back({{name_of_entry(*source), key.entry}});
      entry = std::prev(at->end());
    }
    at = &*entry;
  }
  *at = *source;
}

/// Three digits, as many as a measurement holds; counts whole. "by:37.4" is how often the value is in 37.4.
std::string shown_number(const Json& value, const std::string& unit) {
  static const std::string kBy = "by:";
  constexpr double kWhole = 1000.0;
  if (value.is_string()) return value.get<std::string>();
  const bool ratio = unit.starts_with(kBy);
  if (value.is_number_unsigned() && unit != "s" && !ratio) {
    const std::string count = format_count(value.get<std::uint64_t>());
    return unit.empty() ? count : count + " " + unit;
  }
  const double number = ratio ? std::stod(unit.substr(kBy.size())) / value.get<double>()
                              : value.get<double>() / (unit == "s" ? kMsPerS : 1.0);
  const std::string text = std::abs(number) < kWhole ? fmt::format("{:.3g}", number)
                                                     : format_count(static_cast<std::uint64_t>(number + 0.5));
  return unit.empty() ? text : text + " " + (ratio ? "times" : unit);
}

Result<Json> read_json(const fs::path& file) {
  PALPATE_ASSIGN(const std::string text, read_file(file.string(), kMemoryLimitBytes));
  Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) return Error{"is no JSON document", {}, file.string()};
  return json;
}

struct Template {
  std::string results;  ///< "one-run.json"
  std::string text;
};

Result<Template> read_template(const fs::path& file) {
  static const std::regex kFirst(R"(^<!-- from ([\w.-]+\.json) -->\n)");
  PALPATE_ASSIGN(const std::string text, read_file(file.string(), kMemoryLimitBytes));
  std::smatch first;
  if (!std::regex_search(text, first, kFirst))
    return Error{"does not say from which results it is filled", "begin it with <!-- from FILE.json -->",
                 file.string(), 1};
  return Template{first[1], first.suffix()};
}

/// Everything between braces, with what `use` makes of it.
template <class Use>
Result<std::string> filled(const std::string& text, const std::string& file, const Use& use) {
  std::string result;
  std::int64_t line = 2;  // the first one names the results
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t open = text.find('{', at), close = text.find('}', open);
    result += text.substr(at, close == std::string::npos ? close : open - at);
    line += std::count(text.begin() + static_cast<std::ptrdiff_t>(at),
                       text.begin() + static_cast<std::ptrdiff_t>(std::min(open, text.size())), '\n');
    if (close == std::string::npos) break;
    const std::string words = text.substr(open + 1, close - open - 1);
    const std::optional<std::string> value = use(asked_by(words));
    if (!value) return Error{"the results have no {" + words + "}", {}, file, line};
    result += *value;
    at = close + 1;
  }
  return result;
}

Result<std::string> block(const fs::path& checkout, const std::string& name) {
  const fs::path file = checkout / kFolder / (name + ".txt");
  PALPATE_ASSIGN(const Template form, read_template(file));
  PALPATE_ASSIGN(const Json results, read_json(checkout / kFolder / form.results));
  return filled(form.text, file.string(), [&](const Asked& asked) -> std::optional<std::string> {
    const Json* document = &results;
    if (!asked.document.empty()) {
      document = find(results, "documents");
      if (document == nullptr || !document->contains(asked.document)) return std::nullopt;
      document = &document->at(asked.document);
    }
    const Json* value = find(*document, asked.path);
    if (value == nullptr || value->is_null()) return std::nullopt;
    return shown_number(*value, asked.unit);
  });
}

Result<PageWithFigures> page_of(const fs::path& checkout, const fs::path& file) {
  static const std::regex kBegin(R"(<!-- figures: ([\w-]+) -->\n)");
  PALPATE_ASSIGN(std::string text, read_file(file.string(), kMemoryLimitBytes));
  PageWithFigures page{file, std::move(text), {}, 0};
  std::string::const_iterator at = page.before.begin();
  std::smatch begin;
  while (std::regex_search(at, page.before.cend(), begin, kBegin)) {
    const auto line = 1 + std::count(page.before.cbegin(), begin[0].first, '\n');
    const auto end = static_cast<std::size_t>(begin[0].second - page.before.cbegin());
    const std::size_t closed = page.before.find(kEnd, end);
    if (closed == std::string::npos)
      return Error{"the figures have no end", fmt::format("write {} below them", kEnd), file.string(), line};
    PALPATE_ASSIGN(const std::string figures, block(checkout, begin[1]));
    page.after.append(at, begin[0].second).append(figures);
    at = page.before.cbegin() + static_cast<std::ptrdiff_t>(closed);
    ++page.blocks;
  }
  page.after.append(at, page.before.cend());
  return page;
}

}  // namespace

Result<std::vector<PageWithFigures>> pages_with_figures(const fs::path& checkout) {
  std::vector<fs::path> files = {checkout / "README.md"};
  std::error_code code;
  for (const auto& entry : fs::recursive_directory_iterator(checkout / "docs", code))
    if (entry.path().extension() == ".md") files.push_back(entry.path());
  std::sort(files.begin() + 1, files.end());
  std::vector<PageWithFigures> pages;
  for (const fs::path& file : files) {
    PALPATE_ASSIGN(PageWithFigures page, page_of(checkout, file));
    if (page.blocks > 0) pages.push_back(std::move(page));
  }
  return pages;
}

Result<std::vector<std::string>> write_page_figures(const fs::path& checkout) {
  PALPATE_ASSIGN(const std::vector<PageWithFigures> pages, pages_with_figures(checkout));
  std::vector<std::string> written;
  for (const PageWithFigures& page : pages) {
    if (page.before == page.after) continue;
    PALPATE_TRY(write_file(page.file.string(), page.after));
    written.push_back(page.file.string());
  }
  return written;
}

Status take_page_figures(const fs::path& checkout, const std::string& file, const fs::path& run) {
  Json taken = {{"commit", ""}, {"date", ""}, {"machine", ""}, {"documents", Json::object()}};
  std::map<std::string, Json> read;
  std::optional<Error> wrong;
  const auto take = [&](const Asked& asked) -> std::optional<std::string> {
    if (asked.document.empty()) return std::string();
    if (!read.contains(asked.document)) {
      Result<Json> document = read_json(run / asked.document);
      if (!document) {
        wrong = document.error();
        return std::nullopt;
      }
      // Not every document says where it comes from; those of one run that do agree.
      if (const std::string commit = document->value("commit", ""); !commit.empty()) taken["commit"] = commit;
      if (const std::string began = document->value("started_utc", ""); !began.empty())
        taken["date"] = began.substr(0, std::size_t{10});  // "2026-11-21T16:31:21Z"
      if (const Json* cpu = find(*document, "machine.cpu")) taken["machine"] = *cpu;
      read[asked.document] = *std::move(document);
    }
    const Json* value = find(read[asked.document], asked.path);
    if (value == nullptr || value->is_null()) return std::nullopt;
    if (is_of_another_day(read[asked.document], asked.path)) {
      wrong = Error{asked.path + " came from a cache of meshes", "run `palpate reproduce --no-cache` for it",
                    (run / asked.document).string()};
      return std::nullopt;
    }
    copy_value(read[asked.document], asked.path, taken["documents"][asked.document]);
    return std::string();
  };
  std::error_code code;
  std::vector<fs::path> forms;
  for (const auto& entry : fs::directory_iterator(checkout / kFolder, code))
    if (entry.path().extension() == ".txt") forms.push_back(entry.path());
  std::sort(forms.begin(), forms.end());
  for (const fs::path& path : forms) {
    PALPATE_ASSIGN(const Template form, read_template(path));
    if (form.results != file) continue;
    const Result<std::string> all = filled(form.text, path.string(), take);
    if (!all) return wrong ? *wrong : all.error();
  }
  if (read.empty()) return Error{"no template is filled from " + file, {}, (checkout / kFolder).string()};
  return write_file((checkout / kFolder / file).string(), taken.dump(1) + "\n");
}

}  // namespace palpate::experiments
