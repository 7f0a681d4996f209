// Plug-ins: shared libraries that are loaded at run time and export one function, which returns a table of C
// functions. Devices and renderers have tables of their own.
#pragma once

#include <cstddef>
#include <cstdint>
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

/// Loads a module and calls `entry`. Every table begins with the version `abi` and its size, both uint32_t;
/// those are checked before more is read. The module stays loaded as long as the table is held. An Error says
/// what the system's loader misses, or that the version differs.
[[nodiscard]] Result<std::shared_ptr<const void>> load_plugin_table(const std::filesystem::path& file,
                                                                    const char* entry, std::uint32_t abi,
                                                                    std::size_t size);
template <class Table>
[[nodiscard]] Result<std::shared_ptr<const Table>> load_plugin(const std::filesystem::path& file,
                                                               const char* entry, std::uint32_t abi) {
  PALPATE_ASSIGN(const std::shared_ptr<const void> table, load_plugin_table(file, entry, abi, sizeof(Table)));
  return std::static_pointer_cast<const Table>(table);
}
/// The Error of a table that is too old, too new or lacks a function.
[[nodiscard]] Error not_of_this_version(const std::filesystem::path& file);

}  // namespace palpate
