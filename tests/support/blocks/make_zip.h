// Zip archives for tests: members are stored without compression.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace tessera {

inline uint32_t ZipChecksum(const std::string& bytes) {  // CRC 32
  uint32_t crc = 0xffffffff;
  for (const char byte : bytes) {
    crc ^= static_cast<uint8_t>(byte);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0xedb88320 : 0);
  }
  return ~crc;
}

inline std::string ZipNumber(uint64_t value, int bytes) {
  std::string text;
  for (int i = 0; i < bytes; ++i) text += static_cast<char>(value >> (8 * i));
  return text;
}

// Members with their names, in this order.
inline std::string MakeZip(const std::vector<std::pair<std::string, std::string>>& members) {
  std::string archive, directory;
  for (const auto& [name, content] : members) {
    const std::string sizes = ZipNumber(ZipChecksum(content), 4) + ZipNumber(content.size(), 4) +
                              ZipNumber(content.size(), 4) + ZipNumber(name.size(), 2) + ZipNumber(0, 2);
    const std::string common = ZipNumber(20, 2) + ZipNumber(0, 2) + ZipNumber(0, 2) + ZipNumber(0, 4) + sizes;
    directory += "PK\1\2" + ZipNumber(20, 2) + common + ZipNumber(0, 10) + ZipNumber(archive.size(), 4) + name;
    archive += "PK\3\4" + common + name + content;
  }
  const std::string count = ZipNumber(members.size(), 2);
  return archive + directory + "PK\5\6" + ZipNumber(0, 4) + count + count + ZipNumber(directory.size(), 4) +
         ZipNumber(archive.size(), 4) + ZipNumber(0, 2);
}

}  // namespace tessera
