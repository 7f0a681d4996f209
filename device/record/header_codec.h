// Internal to recordings: header, renderers, notes and the end as bytes.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "device/record/recording_header.h"

namespace palpate::device {

/// What a recording says last.
struct RecordingClose {
  std::uint64_t ticks = 0, written = 0, lost = 0;
  std::string reason;
};

[[nodiscard]] std::vector<std::byte> encode(const RecordingHeader& header);
[[nodiscard]] std::vector<std::byte> encode(std::uint16_t index, const RecordedRenderer& renderer);
[[nodiscard]] std::vector<std::byte> encode_note(const std::string& text);
[[nodiscard]] std::vector<std::byte> encode(const RecordingClose& close);

/// False: it is none.
[[nodiscard]] bool decode(std::span<const std::byte> bytes, RecordingHeader& header);
[[nodiscard]] bool decode(std::span<const std::byte> bytes, std::uint16_t& index, RecordedRenderer& renderer);
[[nodiscard]] bool decode_note(std::span<const std::byte> bytes, std::string& text);
[[nodiscard]] bool decode(std::span<const std::byte> bytes, RecordingClose& close);

}  // namespace palpate::device
