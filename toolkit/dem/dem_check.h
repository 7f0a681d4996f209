// Checks a height grid's header before GDAL allocates. Free of GDAL.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include <palpate/read_model.h>
#include <palpate/result.h>

namespace palpate::dem {

enum class DemFormat : std::uint8_t { kTiff, kPng, kHgt, kUsgs, kEsriAscii, kZip };

/// The file's format by its first bytes, given its name's extension: "tif", "tiff", "png", "hgt", "dem",
/// "asc" or "zip". An Error where name and content contradict each other.
[[nodiscard]] Result<DemFormat> format_of(std::string_view extension, std::span<const std::byte> file);

/// Whether an .asc file is an ESRI grid: it begins with ncols or nrows.
[[nodiscard]] bool is_esri_ascii(std::span<const std::byte> file);

/// Checks the sizes that stand where they can be read without a library: of PNG, SRTM and ESRI ASCII files.
/// Of the others GDAL opens the header, and check_size() judges it before any post is read.
[[nodiscard]] Status check_header(DemFormat format, std::span<const std::byte> file,
                                  const io::ReadOptions& options);

/// Columns and rows as promised, against the file's size and the memory bound.
[[nodiscard]] Status check_size(DemFormat format, std::uint64_t columns, std::uint64_t rows,
                                std::uint64_t bytes, const io::ReadOptions& options);

}  // namespace palpate::dem
