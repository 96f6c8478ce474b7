// SPDX-License-Identifier: Apache-2.0
#include "core/image/oiio/image_output.h"

#include "core/math/problem.h"

namespace marram {

ImageWriter::ImageWriter(const std::string& path, OIIO::ImageSpec spec, const char* format, Links links)
    : path_(path), file_(path, links), proxy_(path, file_), output_(OIIO::ImageOutput::create(format)) {
    if (!output_ || !output_->supports("ioproxy"))
        throw InputError({path},
                         std::string("this OpenImageIO cannot write ") + format + " files to a stream",
                         "install Debian's OpenImageIO, or write another format");
    OIIO::Filesystem::IOProxy* proxy = &proxy_;
    spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    if (!output_->open(path, spec)) refuse("cannot be written");
}

void ImageWriter::refuse(const std::string& what) {
    const std::string message = output_->geterror(), line = message.substr(0, message.find('\n'));
    throw InputError({path_}, what + " (" + (line.empty() ? "no reason given" : line) + ")",
                     "check the folder and its free space, or choose another output");
}

void ImageWriter::write_rows(int begin, int end, OIIO::TypeDesc type, const void* rows) {
    if (!output_->write_scanlines(begin, end, 0, type, rows)) refuse("could not be written");
}

void ImageWriter::commit() {
    if (!output_->close()) refuse("could not be written");
    file_.commit();
}

} // namespace marram
