// Plug-ins: shared libraries that are loaded at run time and export one function, which returns a table of C
// functions. Devices and renderers have tables of their own.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <palpate/result.h>

namespace palpate {

/// Plug-in folders in search order: those of $PALPATE_PLUGINS (separated by colons), then lib/palpate/plugins
/// beside the program's bin.
[[nodiscard]] std::vector<std::filesystem::path> plugin_folders();

struct PluginFile {
  std::string name;  ///< NAME of PREFIX + NAME.so
  std::filesystem::path file;
};
/// Files PREFIX + NAME.so of all folders, by name; of one name the first folder's.
[[nodiscard]] std::vector<PluginFile> plugin_files(std::string_view prefix);

/// A loaded module, unloaded with its last holder. An Error says what the system's loader misses.
[[nodiscard]] Result<std::shared_ptr<void>> load_module(const std::filesystem::path& file);
/// The address of what a module exports under this name, or null.
[[nodiscard]] void* exported(void* module, const char* name) noexcept;
/// The Error of a table that is too old, too new or lacks a function.
[[nodiscard]] Error not_of_this_version(const std::filesystem::path& file);

/// Loads a module and calls `entry`, of type const Table* (*)(). Every table begins with the version `abi`
/// and its size, both uint32_t; those are checked before more is read. The module stays loaded as long as the
/// table is held.
template <class Table>
[[nodiscard]] Result<std::shared_ptr<const Table>> load_plugin(const std::filesystem::path& file,
                                                               const char* entry, std::uint32_t abi) {
  PALPATE_ASSIGN(const std::shared_ptr<void> module, load_module(file));
  const auto function = reinterpret_cast<const Table* (*)()>(exported(module.get(), entry));
  const Table* const table = function != nullptr ? function() : nullptr;
  std::array<std::uint32_t, 2> head{};  // version, size
  if (table != nullptr) std::memcpy(head.data(), table, sizeof(head));
  if (head[0] != abi || head[1] < sizeof(Table)) return not_of_this_version(file);
  return std::shared_ptr<const Table>(module, table);
}

}  // namespace palpate
