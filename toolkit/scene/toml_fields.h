// Tables of a TOML file read by the list of their fields: what is no field, of the wrong kind or missing is
// refused with its line. Internal to scene and to what else reads TOML files of its own.
#pragma once

#include <cstdint>
#include <functional>
#include <type_traits>
#include <utility>

#include "toolkit/scene/toml_reading.h"

namespace palpate::scene {

/// One key of a table, and what reads its value.
struct Field {
  std::string key;
  std::function<Status(const toml::node&, const InFile&)> read;
  bool needed = false;
  /// The kinds of the table that have it; empty: all of them.
  std::vector<std::string> kinds{};

  [[nodiscard]] Field must() && {
    needed = true;
    return std::move(*this);
  }
  [[nodiscard]] Field of(std::vector<std::string> only) && {
    kinds = std::move(only);
    return std::move(*this);
  }
};

/// Keeps a value that was read, or hands on what is wrong with it.
template <class T, class V>
Status keep(Result<T>&& read, V& into) {
  if (!read) return std::move(read).error();
  into = *std::move(read);
  return Done{};
}

/// How a value of each type is read.
inline Status read_value(const toml::node& node, const std::string& key, std::string& into,
                         const InFile& in_file) {
  return keep(text(node, key, in_file), into);
}
inline Status read_value(const toml::node& node, const std::string& key, double& into,
                         const InFile& in_file) {
  return keep(number(node, key, in_file), into);
}
inline Status read_value(const toml::node& node, const std::string& key, std::optional<double>& into,
                         const InFile& in_file) {
  return keep(number(node, key, in_file), into);
}
inline Status read_value(const toml::node& node, const std::string& key, bool& into, const InFile& in_file) {
  const std::optional<bool> value = node.value_exact<bool>();
  if (!value) return in_file.at(node, fmt::format("'{}' must be true or false", key));
  into = *value;
  return Done{};
}
template <class T>
requires std::is_integral_v<T> Status read_value(const toml::node& node, const std::string& key, T& into,
                                                 const InFile& in_file) {
  const std::optional<std::int64_t> value = node.value_exact<std::int64_t>();
  if (!value || *value < 0 || !std::in_range<T>(*value))
    return in_file.at(node, fmt::format("'{}' must be a whole number, 0 or more", key));
  into = static_cast<T>(*value);
  return Done{};
}
template <class T>
Status read_value(const toml::node& node, const std::string& key, std::vector<T>& into,
                  const InFile& in_file) {
  const toml::array* array = node.as_array();
  if (array == nullptr) return in_file.at(node, fmt::format("'{}' must be a list", key));
  for (const toml::node& one : *array)
    if (Status read = read_value(one, key, into.emplace_back(), in_file); !read) return read;
  return Done{};
}

template <class T>
[[nodiscard]] Field field(std::string key, T& into) {
  return {key, [key, &into](const toml::node& node, const InFile& in_file) {
            return read_value(node, key, into, in_file);
          }};
}

/// Reads every field of `table`, which is of this kind; `where` is how an error calls it.
inline Status read_fields(const toml::table& table, const std::vector<Field>& fields,
                          const std::string& where, const std::string& kind, const InFile& in_file) {
  std::vector<std::string> known;
  for (const Field& field : fields)
    if (field.kinds.empty() || is_among(kind, field.kinds)) known.push_back(field.key);
  for (const auto& [key, node] : table)
    for (const Field& field : fields)
      if (field.key == key.str() && !is_among(field.key, known))
        return in_file.at(key.source(), fmt::format("'{}' does nothing for the kind \"{}\"", field.key, kind),
                          "leave it out: it is of " + joined(field.kinds));
  if (Status good = check_keys(table, known, {}, where, in_file); !good) return good;
  for (const Field& field : fields) {
    const toml::node* node = table.get(field.key);
    if (node == nullptr && field.needed && is_among(field.key, known))
      return in_file.at(table.source(), fmt::format("{} needs '{}'", where, field.key));
    if (node == nullptr) continue;
    if (Status read = field.read(*node, in_file); !read) return read;
  }
  return Done{};
}

/// A table inside, "[path]".
[[nodiscard]] inline Field inner(std::string key, std::vector<Field> fields, std::string kind) {
  return {key,
          [key, fields = std::move(fields), kind = std::move(kind)](const toml::node& node,
                                                                    const InFile& in_file) -> Status {
            const Result<const toml::table*> table = table_of(node, key, in_file);
            if (!table) return table.error();
            return read_fields(**table, fields, "[" + key + "]", kind, in_file);
          }};
}

/// A list of tables, "[[model]]": each becomes a T, by the fields that `fields_of` names of it.
template <class T>
[[nodiscard]] Field list(std::string key, std::vector<T>& into,
                         std::function<std::vector<Field>(T&, const std::string& kind)> fields_of,
                         std::string kind) {
  return {key,
          [key, &into, fields_of = std::move(fields_of), kind = std::move(kind)](
              const toml::node& node, const InFile& in_file) -> Status {
            const toml::array* array = node.as_array();
            if (array == nullptr || !array->is_homogeneous(toml::node_type::table))
              return in_file.at(node, fmt::format("'{}' must be a list of tables", key),
                                fmt::format("write [[{}]] with two brackets", key));
            for (const toml::node& one : *array) {
              T& entry = into.emplace_back();
              if (Status read =
                      read_fields(*one.as_table(), fields_of(entry, kind), "[[" + key + "]]", kind, in_file);
                  !read)
                return read;
            }
            return Done{};
          }};
}

}  // namespace palpate::scene
