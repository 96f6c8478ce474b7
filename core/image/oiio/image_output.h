// SPDX-License-Identifier: Apache-2.0
// OpenImageIO's writers on top of an AtomicFile. The underlying libraries ignore some failed writes (PNG all
// of them, EXR the last buffered block, TIFF its directory). Here every byte goes through the AtomicFile,
// whose commit() reports the first failure.
#pragma once

#include "core/image/atomic_file.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <memory>
#include <string>

namespace marram {

// Passes writes of a library to the file. The library never sees a failure.
class AtomicProxy final : public OIIO::Filesystem::IOProxy {
  public:
    AtomicProxy(const std::string& path, AtomicFile& file) : IOProxy(path, Write), file_(file) {}
    const char* proxytype() const override { return "marram"; }
    int64_t tell() override { return file_.position(); }
    bool seek(int64_t position) override {
        file_.seek(position);
        return true;
    }
    size_t read(void* bytes, size_t count) override { return file_.get(bytes, count); }
    size_t write(const void* bytes, size_t count) override {
        file_.put(bytes, count);
        return count;
    }
    size_t pread(void* bytes, size_t count, int64_t position) override {
        const int64_t here = file_.position();
        file_.seek(position);
        const size_t got = file_.get(bytes, count);
        file_.seek(here);
        return got;
    }
    size_t pwrite(const void* bytes, size_t count, int64_t position) override {
        const int64_t here = file_.position();
        file_.seek(position);
        file_.put(bytes, count);
        file_.seek(here);
        return count;
    }
    size_t size() const override { return size_t(file_.size()); }

  private:
    AtomicFile& file_;
};

// Writes one picture. Without commit(), or after a failure, an existing file of that name is unchanged.
class ImageWriter {
  public:
    // format: "openexr", "png", "tiff". Throws InputError that names `path`.
    ImageWriter(const std::string& path, OIIO::ImageSpec spec, const char* format,
                Links links = Links::follow);
    void write_rows(int begin, int end, OIIO::TypeDesc type, const void* rows);
    void commit();

  private:
    [[noreturn]] void refuse(const std::string& what);

    std::string path_;
    AtomicFile file_;
    AtomicProxy proxy_;
    std::unique_ptr<OIIO::ImageOutput> output_; // destroyed before the proxy
};

} // namespace marram
