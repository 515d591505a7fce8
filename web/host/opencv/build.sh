#!/bin/bash
# Builds opencv.wasm from OpenCV's sources, opencv.cpp and code.cpp: build.sh [FOLDER]
#
# Needs Debian 12's packages emscripten (3.1.6), cmake and ninja-build, and pip. It takes some six
# minutes on two cores and makes the same file each time. Sources and objects stay in FOLDER, or in
# build/opencv, so that another run compiles only what has changed.
set -euo pipefail

here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "${1:-build/opencv}"
cd "${1:-build/opencv}"
package=opencv-python-headless-4.12.0.88
sha256=cfdc017ddf2e59b6c2f53bc12d74b6b0be7ded4ec59083ea70763921af2b6c09
export NODE_PATH=/usr/share/nodejs # where Debian has emscripten's parser

if [ ! -d $package ]; then
  pip download --no-deps --no-binary opencv-python-headless "${package/less-/less==}"
  echo "$sha256  $package.tar.gz" | sha256sum --check
  mkdir fresh
  tar xzf $package.tar.gz -C fresh
  # in this library WebAssembly rounds halves up, and negative numbers wrongly; all others do not
  patch -d fresh/$package/opencv -p1 <"$here/rounding.patch"
  mv fresh/$package . && rmdir fresh
fi
library=$PWD/$package/opencv
cat "$library"/{LICENSE,COPYRIGHT,modules/core/3rdparty/SoftFloat/COPYING.txt} >"$here/LICENSE"

flags="-msimd128 -mnontrapping-fptoint -ffile-prefix-map=$PWD=."
optimised="-O3 -DNDEBUG"
unused=$(printf -- '-DWITH_%s=OFF ' ADE EIGEN IPP ITT LAPACK OPENCL PROTOBUF PTHREADS_PF QUIRC)
emcmake cmake -G Ninja -S "$library" -B objects -DCMAKE_BUILD_TYPE=Release \
  -DBUILD_LIST=core,imgproc,video,calib3d -DBUILD_SHARED_LIBS=OFF -DBUILD_opencv_apps=OFF \
  -DCV_ENABLE_INTRINSICS=ON -DCPU_BASELINE= -DCPU_DISPATCH= -DCV_TRACE=OFF \
  -DOPENCV_DISABLE_FILESYSTEM_SUPPORT=ON -DBUILD_ZLIB=ON $unused \
  -DCMAKE_C_FLAGS="$flags" -DCMAKE_CXX_FLAGS="$flags" \
  -DCMAKE_C_FLAGS_RELEASE="$optimised" -DCMAKE_CXX_FLAGS_RELEASE="$optimised" >objects.log
echo '""' >objects/modules/core/version_string.inc # no word of this machine and its folders
parts=(lib/libopencv_imgproc.a lib/libopencv_core.a
  modules/video/CMakeFiles/opencv_video.dir/src/lkpyramid.cpp.o
  modules/calib3d/CMakeFiles/opencv_calib3d.dir/src/{fundam,ptsetreg,levmarq,rho}.cpp.o)
ninja -C objects "${parts[@]}" >>objects.log
cd objects
em++ -std=c++17 $optimised $flags -I. $(printf -- "-I$library/modules/%s/include " \
  core imgproc video calib3d features2d flann) -I"$library/include" "$here"/{opencv,code}.cpp \
  "${parts[@]:2}" "${parts[@]:0:2}" -o opencv.wasm -sSTANDALONE_WASM --no-entry \
  -sALLOW_MEMORY_GROWTH -sERROR_ON_UNDEFINED_SYMBOLS=0
cp opencv.wasm "$here"
cd "$here"
sha256sum build.sh code.cpp opencv.cpp opencv.wasm plane.h rounding.patch >SHA256SUMS
