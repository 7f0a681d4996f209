#include "toolkit/scene/toml_fields.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

namespace palpate::scene {
namespace {

bool is_of(const Field& field, const std::string& kind) {
  return field.kinds.empty() || std::find(field.kinds.begin(), field.kinds.end(), kind) != field.kinds.end();
}

/// A kind in a message: a word in quotes, a phrase unchanged.
std::string called(const std::string& kind) {
  return kind.find(' ') == std::string::npos ? fmt::format("the kind \"{}\"", kind) : kind;
}

Status check_key(const toml::key& key, const Fields& fields, const std::string& where,
                 const std::string& kind, const TomlFile& in_file) {
  const std::string name(key.str());
  const Field* other = nullptr;
  for (const Field& field : fields) {
    if (field.key != name) continue;
    if (!is_of(field, kind)) {
      other = &field;
      continue;
    }
    if (field.read) return Done{};
    return in_file.at(key.source(), fmt::format("'{}' in {} is not in this version", name, where),
                      "it comes with a later version; remove it");
  }
  if (other != nullptr)
    return in_file.at(key.source(), fmt::format("'{}' does nothing for {}", name, called(kind)),
                      "leave it out: it is of " + joined(other->kinds, ", and of "));
  std::vector<std::string> known;
  for (const Field& field : fields)
    if (field.read && is_of(field, kind)) known.push_back(field.key);
  return in_file.at(key.source(), fmt::format("{} has no key {}", where, shown(name)),
                    did_you_mean(name, known, "it has " + joined(known)));
}

}  // namespace

std::string TomlFile::beside(const std::string& name) const {
  return (std::filesystem::path(file).parent_path() / name).lexically_normal().string();
}

Field Field::must(std::string write) && {
  needed = true;
  example = std::move(write);
  return std::move(*this);
}

Field Field::of(std::vector<std::string> only) && {
  kinds = std::move(only);
  return std::move(*this);
}

Status read_fields(const toml::table& table, const Fields& fields, const std::string& where,
                   const std::string& kind, const TomlFile& in_file) {
  for (const auto& [key, node] : table) PALPATE_TRY(check_key(key, fields, where, kind, in_file));
  for (const Field& field : fields) {
    if (!is_of(field, kind)) continue;
    const toml::node* node = table.get(field.key);
    if (node != nullptr)
      PALPATE_TRY(field.read(*node, field.key, in_file));
    else if (field.needed)
      return in_file.at(table, fmt::format("{} needs '{}'", where, field.key), field.example);
  }
  return Done{};
}

Result<double> number(const toml::node& node, const std::string& key, const TomlFile& in_file,
                      const NumberRange& range, const std::string& remedy) {
  const std::optional<double> value = node.is_number() ? node.value<double>() : std::nullopt;
  if (!value || !std::isfinite(*value))
    return in_file.at(node, fmt::format("'{}' must be a finite number", key));
  if (*value < range.low || *value > range.high || (range.above_low && *value == range.low))
    return in_file.at(node, fmt::format("'{}' must be {}", key, text_of(range)), remedy);
  return *value;
}

Result<std::string> text(const toml::node& node, const std::string& key, const TomlFile& in_file) {
  const std::optional<std::string> value = node.value_exact<std::string>();
  if (!value || value->empty()) return in_file.at(node, fmt::format("'{}' must be a text in quotes", key));
  return *value;
}

Result<std::string> option_text(const toml::node& node, const std::string& key, const TomlFile& in_file) {
  if (const auto value = node.value_exact<std::string>()) return *value;
  if (const auto value = node.value_exact<bool>()) return std::string(*value ? "true" : "false");
  if (const auto value = node.value_exact<std::int64_t>()) return fmt::format("{}", *value);
  if (const auto value = node.value_exact<double>()) return fmt::format("{}", *value);
  return in_file.at(node, fmt::format("'{}' must be a text, a number, true or false", key));
}

Result<const toml::table*> table_of(const toml::node& node, const std::string& name,
                                    const TomlFile& in_file) {
  const toml::table* table = node.as_table();
  if (table == nullptr)
    return in_file.at(node, fmt::format("'{}' must be a table, written [{}]", name, name));
  return table;
}

Result<std::vector<const toml::table*>> tables_of(const toml::node& node, const std::string& name,
                                                  const TomlFile& in_file) {
  const toml::array* list = node.as_array();
  if (list == nullptr || list->empty() || !list->is_homogeneous(toml::node_type::table))
    return in_file.at(node, fmt::format("'{}' must be a list of tables", name.substr(name.rfind('.') + 1)),
                      fmt::format("write [[{}]] with two brackets", name));
  std::vector<const toml::table*> tables;
  for (const toml::node& entry : *list) tables.push_back(entry.as_table());
  return tables;
}

Field file(std::string key, std::string& into) {
  return {std::move(key),
          [&into](const toml::node& node, const std::string& name, const TomlFile& in_file) -> Status {
            PALPATE_ASSIGN(const std::string given, text(node, name, in_file));
            into = in_file.beside(given);
            return Done{};
          }};
}

Field inner(std::string key, Fields fields, std::string kind, std::string name) {
  if (name.empty()) name = key;
  return {std::move(key),
          [fields = std::move(fields), kind = std::move(kind), name = std::move(name)](
              const toml::node& node, const std::string&, const TomlFile& in_file) -> Status {
            PALPATE_ASSIGN(const toml::table* table, table_of(node, name, in_file));
            return read_fields(*table, fields, "[" + name + "]", kind, in_file);
          }};
}

}  // namespace palpate::scene
