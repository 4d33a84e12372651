// Findings of the doctor in Chinese: title and meaning by the name of the check. Observations and commands contain names
// and paths of this machine, and stay untranslated.

/** @typedef {Record<string, { title: string, meaning: string }>} Findings */

/** @type {Findings} */
const hans = {
  "ModemManager": { title: "ModemManager 服务", meaning: "它可能把新插入的端口当作调制解调器：最多 20 秒内端口被占用，并会收到它发送的数据。" },
  "WSL": { title: "Windows 中的 Linux（WSL）", meaning: "USB 设备每次插入后都留在 Windows 中，需要先移交给 Linux。" },
  "brltty": { title: "brltty 服务", meaning: "它会把这类适配器误认为盲文显示器：端口出现一秒后就消失。" },
  "container": { title: "容器", meaning: "容器只能看到启动时传入的设备。" },
  "hid package": { title: "hid 软件包", meaning: "Python 找到的 hid 模块不是 hidapi，或者没有安装，因此无法通过 HID 连接主板。" },
  "in use": { title: "端口被占用", meaning: "主板已被其他程序打开。多数端口只允许一个程序；同时使用会互相抢走数据。" },
  "latency timer": { title: "延迟定时器", meaning: "适配器会把收到的数据扣留一段时间才交给程序，每次应答都因此变慢。" },
  "libusb": { title: "libusb 库", meaning: "无法通过 USB 批量传输连接主板。" },
  "macOS port": { title: "macOS 端口", meaning: "tty. 端口会等待主板不会发出的载波信号；同名的 cu. 端口不会。" },
  "permissions": { title: "权限", meaning: "您没有打开此设备的权限。" },
  "sandbox": { title: "沙盒", meaning: "这个 Python 的打包方式会对其中的程序隐藏设备。" },
  "udev": { title: "udev 规则", meaning: "该规则不起作用：系统在读取它之前就已处理完设备权限。" },
};

/** @type {Findings} */
const hant = {
  "ModemManager": { title: "ModemManager 服務", meaning: "它可能把剛插上的連接埠當成數據機：連接埠最多被佔用 20 秒，並且會收到它傳送的資料。" },
  "WSL": { title: "Windows 裡的 Linux（WSL）", meaning: "USB 裝置每次插上之後都留在 Windows，必須先交給 Linux。" },
  "brltty": { title: "brltty 服務", meaning: "它會把這類轉接器誤認為點字顯示器：連接埠出現一秒後就消失。" },
  "container": { title: "容器", meaning: "容器只看得到啟動時交給它的裝置。" },
  "hid package": { title: "hid 套件", meaning: "Python 找到的 hid 模組不是 hidapi，或者沒有安裝，因此無法透過 HID 連到控制板。" },
  "in use": { title: "連接埠使用中", meaning: "控制板已被其他程式開啟。多數連接埠只允許一個程式；同時使用會互相搶走資料。" },
  "latency timer": { title: "延遲計時器", meaning: "轉接器會把收到的資料保留一段時間才交給程式，每次回應都因此變慢。" },
  "libusb": { title: "libusb 程式庫", meaning: "無法透過 USB 大量傳輸（bulk）連到控制板。" },
  "macOS port": { title: "macOS 連接埠", meaning: "tty. 連接埠會等待控制板不會送出的載波訊號；同名的 cu. 連接埠則不會。" },
  "permissions": { title: "權限", meaning: "你沒有開啟這個裝置的權限。" },
  "sandbox": { title: "沙箱", meaning: "這個 Python 的封裝方式會讓其中的程式看不到裝置。" },
  "udev": { title: "udev 規則", meaning: "這條規則沒有作用：系統在讀到它之前就已處理完裝置的權限。" },
};

/** @type {Partial<Record<import("./text.js").Language, Findings>>} */
export const FINDINGS = { "zh-Hans": hans, "zh-Hant": hant };
