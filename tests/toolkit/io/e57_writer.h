// E57 files for tests, written from the standard's layout: pages with checksums, packets, XML. Everything can
// be made wrong on purpose.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "toolkit/core/bytes.h"
#include "toolkit/io/e57_binary.h"

namespace palpate::io {

/// A stream of bits, lowest first.
class BitStream {
 public:
  void put(std::uint64_t value, unsigned bits) {
    for (unsigned b = 0; b < bits; ++b, ++count_) {
      if (count_ % 8 == 0) bytes_.push_back('\0');
      if ((value >> b & 1u) != 0)
        bytes_.back() = static_cast<char>(static_cast<unsigned char>(bytes_.back()) | (1u << (count_ % 8)));
    }
  }
  void put(double value) { put(std::bit_cast<std::uint64_t>(value), 64); }
  void put(float value) { put(std::bit_cast<std::uint32_t>(value), 32); }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
  std::size_t count_ = 0;
};

inline std::string little(std::uint64_t value, std::size_t bytes) {
  std::string text;
  for (std::size_t i = 0; i < bytes; ++i) text += static_cast<char>(value >> (8 * i) & 0xFFu);
  return text;
}

/// One packet with a piece of each stream.
inline std::string data_packet(const std::vector<std::string>& pieces) {
  std::string lengths, content;
  for (const std::string& piece : pieces) {
    lengths += little(piece.size(), 2);
    content += piece;
  }
  std::string rest = little(pieces.size(), 2) + lengths + content;
  while (rest.size() % 4 != 0) rest += '\0';
  return std::string("\1\0", 2) + little(rest.size() + 3, 2) + rest;
}
inline std::string empty_packet(std::size_t bytes) {
  return std::string("\2\0", 2) + little(bytes - 1, 2) + std::string(bytes - 4, '\0');
}
inline std::string index_packet() {
  constexpr std::size_t kBytes = 32;  // 16 of the head, 16 of one entry
  return std::string("\0\0", 2) + little(kBytes - 1, 2) + little(1, 2) + std::string(kBytes - 6, '\0');
}

struct E57TestScan {
  std::string prototype;  // XML of the fields
  std::vector<std::string> packets;
  std::uint64_t records = 0;
  std::string more{};  // XML beside the points: pose, name
  std::string codecs{};
};

/// The file without checksums, from which pages are made.
struct E57TestFile {
  std::string logical = std::string(kE57HeaderBytes, '\0');
  std::string xml_scans{};
  std::string xml{};  // replaces what is made of the scans

  void add(const E57TestScan& scan) {
    while (logical.size() % 4 != 0) logical += '\0';
    const std::uint64_t section = logical.size();
    std::string packets;
    for (const std::string& packet : scan.packets) packets += packet;
    constexpr std::uint64_t kHead = 32;
    logical += std::string("\1", 1) + std::string(7, '\0') + little(kHead + packets.size(), 8) +
               little(E57Pages::physical_at(section + kHead), 8) + little(0, 8) + packets;
    xml_scans += fmt::format(
        "<vectorChild type=\"Structure\">{}<points type=\"CompressedVector\" fileOffset=\"{}\" "
        "recordCount=\"{}\"><prototype type=\"Structure\">{}</prototype><codecs type=\"Vector\">{}</codecs>"
        "</points></vectorChild>\n",
        scan.more, E57Pages::physical_at(section), scan.records, scan.prototype, scan.codecs);
  }

  [[nodiscard]] std::string bytes() const {
    std::string text = logical;
    const std::uint64_t xml_at = text.size();
    const std::string document =
        xml.empty() ? "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<e57Root type=\"Structure\">\n"
                      "<data3D type=\"Vector\">\n" +
                          xml_scans + "</data3D>\n</e57Root>\n"
                    : xml;
    text += document;
    text.resize((text.size() + kE57PageContent - 1) / kE57PageContent * kE57PageContent);
    const std::uint64_t pages = text.size() / kE57PageContent;
    const std::string header = std::string(kE57Signature) + little(1, 4) + little(0, 4) +
                               little(pages * kE57PageBytes, 8) + little(E57Pages::physical_at(xml_at), 8) +
                               little(document.size(), 8) + little(kE57PageBytes, 8);
    text.replace(0, header.size(), header);
    std::string file;
    for (std::uint64_t p = 0; p < pages; ++p)
      file += text.substr(p * kE57PageContent, kE57PageContent) + "crc.";
    seal(file);
    return file;
  }

  /// Makes the checksums right again.
  static void seal(std::string& file) {
    for (std::size_t at = 0; at + kE57PageBytes <= file.size(); at += kE57PageBytes) {
      const std::uint32_t crc =
          crc32c(std::as_bytes(std::span(file)).subspan(at, static_cast<std::size_t>(kE57PageContent)));
      for (std::size_t i = 0; i < 4; ++i)
        file[at + kE57PageContent + i] = static_cast<char>(crc >> (8 * (3 - i)) & 0xFFu);
    }
  }
};

}  // namespace palpate::io
